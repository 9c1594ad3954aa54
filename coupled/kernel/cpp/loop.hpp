// The loop over the steps: error control, breakpoints, dense output, events, when to come back.
//
// It can be left and entered again: all it needs stands in `Loop`, y and the caller's arrays. It returns when it is
// done, after a number of steps (for progress and Ctrl-C), when rows are full, at an event, where the state rests (an
// L-stable method would stay on an unstable fixed point: the caller looks at the eigenvalues and bounds the step), or
// where no step is small enough.
#pragma once
#include "step.hpp"

struct Loop {
  double t, h, h_before, size_before, growth;  // the step to try; the last one and its size
  double rtol, longest, restart;               // bound of every step; the step to try after a jump
  double cap, rest_step;  // where the state rests: bound of the step; step when RESTING came last
  double level, seen, crossing;                // of an event: distance from the level, last time
  int64_t accepted, rejected;
  int64_t rest_again;            // number of accepted steps from which RESTING comes again
  int64_t filled, room, budget;  // rows written; room of `steps`; steps until it returns STEPS
  int begun, piece, entered, fresh, per_step;
  int quantity, ring, stop;  // event: 0 none, 1 U, 2 N, 3 dT, of which ring; whether it ends there
  Past past;
};
enum { DONE, STEPS, FULL, EVENT, RESTING, TOO_SMALL };
constexpr double GROWTH = 5.0;     // largest ratio of two steps
constexpr double QUIET = 1e-2;     // relative change in a step of a state that rests
constexpr double QUIET_STEP = 0.1; // lifetimes of the carriers; no mode turns within a shorter step

// One component at the fraction x of a step from a to b with the stages k.
inline double dense_output(double x, double a, double b, const double* k, int row, const Method& m) {
  double d[3] = {0, 0, 0};
  for (int j = 0; j < m.stages; j++)
    for (int i = 0; i < 3; i++) d[i] += m.dense[i * m.stages + j] * k[j * row];
  return (1 - x) * a + x * (b + (1 - x) * (d[0] + x * (d[1] + x * d[2])));
}

// A `System` takes the steps: of one ring (`Single`) or of a circuit (`Network`).
template <class System> struct Integration {
  static constexpr int F = System::F, B = 2 * F + 1, Z = B + 1;
  const Problem& p;
  Loop& L;
  double *y, *out, *rows;
  System system;
  const int R, K, size, width;
  Light light[STAGES];
  Integration(const Problem& problem, Loop& loop, double* state, double* kept, Arena& arena)
      : p(problem), L(loop), y(state), rows(kept), system(p, L.past, arena), R(p.rings), K(p.order),
        size(R * (B + K)), width(1 + R * Z + system.width()) {
    out = arena.take<double>(size);
    for (Light& one : light) one = light_of(arena, R * F);
  }
  void at(double x, int i, double* state) const {  // fields, N and dT of a ring at the fraction x of the last step
    for (int m = 0; m < Z; m++) {
      const double a = m < B ? y[i * B + m] : system.z_start[i];
      const double b = m < B ? out[i * B + m] : system.z_end[i];
      state[m] = x == 1 ? b : dense_output(x, a, b, system.k + i * Z + m, R * Z, p.method);
    }
    state[B] += p.bend[i] * state[B] * state[B] + system.other(x, i);
  }
  void keep(int piece, double x, double t) {
    double* row = rows + width * L.filled++;
    row[0] = t;
    for (int i = 0; i < R; i++) at(x, i, row + 1 + i * Z);
    system.observe(piece, x, t, L.h, row + 1, row + 1 + R * Z);
  }
  void renew(int piece, double t) {  // waves in the rows at the start of a piece become those after it
    for (int64_t k = L.filled; k-- > 0 && rows[width * k] >= t - p.time_tolerance;)
      system.observe(piece, 0, t, L.h, rows + width * k + 1, rows + width * k + 1 + R * Z);
  }
  double watched(const double* s) const {
    return (L.quantity == 1 ? s[0] * s[0] + s[1] * s[1] : s[L.quantity == 2 ? 2 * F : B]) - L.level;
  }
  void begin(const double* times, int64_t wanted) {
    memcpy(out, y, size * sizeof(double));
    double state[Z];
    at(1, L.ring, state);
    if (L.quantity && !(L.seen < INFINITY)) L.seen = watched(state);
    if (!wanted) keep(0, 1, L.t);
    while (L.filled < wanted && times[L.filled] <= L.t) keep(0, 1, times[L.filled]);
  }
  // Error of the last step in units of the tolerance: root mean square over field, carriers and temperature of the
  // worst ring. `moved`: the largest relative change.
  double error(double& moved) const {
    const int last = p.method.stages - 1;
    double worst = 0;
    moved = 0;
    for (int i = 0; i < R; i++) {
      const double *k = system.k + (last * R + i) * Z, *a = y + i * B, *b = out + i * B;
      const double *floor = p.floor + 3 * i, z0 = system.z_start[i], z1 = system.z_end[i];
      const double other = system.other(0, i);
      double e = 0;
      for (int f = 0; f < 2 * F; f += 2) {
        const double then = b[f] * b[f] + b[f + 1] * b[f + 1];
        const double U = fmax(fmax(a[f] * a[f] + a[f + 1] * a[f + 1], then), floor[0] * floor[0]);
        const double re = b[f] - a[f], im = b[f + 1] - a[f + 1];
        e += (k[f] * k[f] + k[f + 1] * k[f + 1]) / (F * U);
        moved = fmax(moved, sqrt((re * re + im * im) / fmax(then, floor[0] * floor[0])));
      }
      const double N0 = a[2 * F], N1 = b[2 * F];
      const double eN = k[2 * F] / fmax(fmax(fabs(N0), fabs(N1)), floor[1]);
      const double eT = system.heat_error(i, L.t + L.h)
                        / fmax(fmax(fabs(z0 + other), fabs(z1 + other)), floor[2]);
      e += eN * eN + eT * eT;
      moved = fmax(moved, fabs(N1 - N0) / fmax(fabs(N1), floor[1]));
      moved = fmax(moved, fabs(z1 - z0) / fmax(fabs(z1), floor[2]));
      worst = e >= 0 && 1 + 2 * p.bend[i] * z1 > 0 ? fmax(worst, e) : INFINITY;  // nan, or the top
    }
    return sqrt(worst / 3) / L.rtol;
  }
  double crossing() {  // where in the last step the event is, by bisection of the dense output; 2 if nowhere
    double state[Z];
    at(1, L.ring, state);
    const double rest = watched(state);
    const bool rises = L.quantity && L.seen < 0 && rest >= 0;
    L.seen = rest;
    if (!rises) return 2;
    double low = 0, high = 1;
    for (int n = 0; n < 50; n++) {
      const double x = 0.5 * (low + high);
      at(x, L.ring, state);
      (watched(state) < 0 ? low : high) = x;
    }
    L.crossing = L.t + high * L.h;
    return high;
  }
  void stop_at(double x) {  // y at the fraction x of the step
    const auto& m = p.method;
    double* z = system.k;
    for (int i = 0; i < R * B; i++) y[i] = dense_output(x, y[i], out[i], z + i / B * Z + i % B, R * Z, m);
    for (int i = R * B; i < size; i++) y[i] = dense_output(x, y[i], out[i], system.kx + (i - R * B), R * K, m);
    L.t = L.crossing;
  }
  // times: wanted ones, or none for the accepted steps, with `per_step` rows each.
  // steps: null, or room for the lengths of the accepted steps.
  int run(int64_t capacity, const double* times, int64_t wanted, double* steps) {
    double loss = 0, tau0 = INFINITY;
    for (int i = 0; i < R; i++)
      loss = fmax(loss, p.modes[i * F].loss), tau0 = fmin(tau0, p.carriers[i].tau0);
    const double cautious = 1e-2 / loss, end = p.edges[p.pieces];
    system.begin(y, !L.begun, L.t);
    if (!L.begun) {
      L.begun = 1, L.restart = cautious, L.growth = GROWTH, L.size_before = 1, L.cap = INFINITY;
      if (!(L.h > 0)) L.h = cautious;
      L.h = fmin(L.h, L.longest);
      begin(times, wanted);
    }
    int64_t budget = L.budget;
    for (; L.piece < p.pieces; L.piece++, L.entered = 0) {
      const double begin = p.edges[L.piece], stop = p.edges[L.piece + 1];
      const bool varies = p.varies[L.piece];
      for (int q = 0; !varies && q < p.method.stages; q++) light_at(p, L.piece, L.t, light[q]);
      if (!L.entered) {
        L.entered = 1;
        if (p.waves) renew(L.piece, begin);
        if (L.piece > 0 && p.jumps[L.piece])
          L.h = fmin(L.h, L.restart), L.h_before = L.rest_step = 0, L.fresh = 1, L.cap = INFINITY;
      }
      while (L.t < stop) {
        if (budget-- <= 0) return STEPS;
        if (!wanted && L.filled + L.per_step > capacity) return FULL;
        if ((steps && L.accepted == L.room) || (p.delays && L.past.filled == L.past.room)) return FULL;
        L.h = system.resolved(L.t, L.h);
        const double planned = L.h;
        const bool landing = L.t + 1.0001 * L.h >= stop;
        if (landing) L.h = stop - L.t;
        for (int q = 0; varies && q < p.method.stages; q++)
          light_at(p, L.piece, L.t + p.method.at[q] * L.h, light[q]);
        double moved = 0, err = INFINITY;
        if (system.step(y, L.t, L.h, light, out)) err = error(moved);
        double taken = fmax(err, 1e-8);  // the step, in units of what the tolerance allows
        taken = p.method.order == 4 ? sqrt(sqrt(taken)) : pow(taken, 1.0 / p.method.order);
        if (!(err <= 1)) {
          L.rejected++, L.growth = 1;
          L.h *= err < INFINITY ? fmax(0.2, 0.9 / taken) : 0.2;
          const bool top = err == INFINITY && L.h < 1e-3 * cautious;
          if (L.h < 1e-13 * fmax(fabs(L.t), 1e-3) || top) return TOO_SMALL;
          continue;
        }
        if (L.fresh)  // what would have been right; a longer one would not resolve the field
          L.restart = fmin(L.h * fmax(0.2, fmin(GROWTH, 0.8 / taken)), 0.5 / loss), L.fresh = 0;
        const double event = L.quantity ? crossing() : 2;
        const bool halt = event <= 1 && L.stop, last = landing && stop == end;
        const double until = halt ? L.crossing : L.t + L.h, part = halt ? event : 1;
        system.note(L.piece, L.t, L.h, [&](double x, int i, double* state) { at(x, i, state); });
        while (L.filled < wanted && ((last && !halt) || times[L.filled] <= until))
          keep(L.piece, (times[L.filled] - L.t) / L.h, times[L.filled]);
        for (int j = 1; !wanted && j < L.per_step; j++)
          keep(L.piece, part * j / L.per_step, L.t + part * j / L.per_step * L.h);
        const double arrived = halt ? L.crossing : landing ? stop : L.t + L.h;
        if (!wanted) keep(L.piece, part, arrived);
        if (steps) steps[L.accepted] = part * L.h;
        L.accepted++;
        if (halt) stop_at(event);
        if (halt) return EVENT;
        system.accept(L.t, L.h, planned, arrived);
        L.t = arrived;
        memcpy(y, out, size * sizeof(double));
        double factor = 0.9 / taken;
        if (L.h_before > 0) factor = fmin(factor, factor * L.h / L.h_before * L.size_before / taken);
        L.h_before = L.h, L.size_before = fmax(taken, 0.3);
        L.h *= fmax(0.2, fmin(L.growth, factor)), L.growth = GROWTH;
        if (landing && L.t < end) L.h = fmax(L.h, planned);
        L.h = fmin(L.h, L.longest);
        const int next = L.piece + 2 < p.pieces ? L.piece + 2 : p.pieces;
        const double coming = L.t < stop ? stop - L.t : p.edges[next] - L.t;
        bool resting = false;
        if (fmin(L.h, coming) > QUIET_STEP * tau0 && moved <= QUIET) {
          L.h = fmin(L.h, L.cap);
          resting = L.h > 4 * L.rest_step || L.accepted >= L.rest_again;
        }
        if (event <= 1) return EVENT;
        if (resting) return RESTING;
      }
    }
    return DONE;
  }
};
