// Closed orbits of one ring in a fraction of a millisecond, for maps: Newton's method on the return
// of the carriers, y_0 -> y(T), where N rises again through its value in y_0.
//
// Light, carriers and fast heat forget in a turn where they began. So Newton's method is for the
// slow heat, n states, alone, and all others are what the last turn returned. With the n columns
// of M, the derivative of the return map by the slow heat, and dT, that of its duration,
//
//   (1 - M_slow) b = y_slow(T) - y_slow(0),      y_0 <- y(T) + M b,      T <- T + dT b.
//
// M is that of a neighbour in the map until a trace comes near, and then follows from its steps.
// Broyden's updates mend it from turn to turn.
#include "kernel.hpp"

constexpr double SMALLEST = 0.02;  // relative range of N, in proportion to which they are stricter
constexpr double NEAR = 1e-3;      // relative step of Newton's method from which traces are fine
constexpr double CLOSED = 30;      // tolerances that the last step is
constexpr double SAME = 4e-7;      // error of the T that it foretold
constexpr double MOVED = 2e-3;                // since M was computed, after which it is again
constexpr double LARGEST = 0.3, LONGER = 2.5; // step; T, of the one at the beginning
constexpr int TURNS = 14;

struct Turns {
  const Problem* p;
  double* edges;        // of p; the last one is where a trace ends
  const double* fixed;  // fixed points: U, N, dT and the longest step beside each
  const int* slow;      // states of slow heat
  double *rows, *steps; // of the last trace: t, field, N, dT; lengths
  int64_t fixed_count, n, room, filled, count;  // n: of slow; room: for rows
  char* memory;         // of as many bytes as `ring_close` asks for where it is null
};

// The longest step beside the fixed point that is nearest to a row; with more it stayed on one.
static double longest_step(const Turns& c, const double* row) {
  const double U = row[1] * row[1] + row[2] * row[2];
  double nearest = INFINITY, longest = INFINITY;
  for (int64_t k = 0; k < c.fixed_count; k++) {
    const double* f = c.fixed + 4 * k;
    const double by_carriers = fabs(row[3] / f[1] - 1), by_heat = fabs(row[4] / f[2] - 1);
    const double off = fmax(fabs(U / f[0] - 1), fmax(by_carriers, by_heat));
    if (off < nearest) nearest = off, longest = f[3];
  }
  return longest;
}

// On from y for `duration`, or until N rises through `level`, at which y may begin; rows and steps
// are added to those there are. h: the first step, then the next one; T: the time is added to it.
// Returns as the loop does; FULL: again with more room.
EXPORT int ring_turn(Turns* c, double* y, double duration, double level, int above, double rtol,
                     double* h, double* T) {
  Loop L = {};
  double *rows = c->rows + 5 * c->filled, *steps = c->steps + c->count;
  c->edges[1] = duration;
  L.h = *h, L.rtol = rtol, L.longest = INFINITY, L.per_step = 1;
  L.budget = L.room = c->room - c->count, L.seen = above ? 0 : INFINITY;
  if (level < INFINITY) L.quantity = 2, L.level = level, L.stop = 1;
  int status = RESTING;
  for (const int64_t room = c->room - c->filled; status == RESTING;) {
    status = (int)ring_integrate(c->p, &L, y, rows, room, nullptr, 0, steps, c->memory);
    if (status != RESTING) break;
    L.cap = longest_step(*c, rows + 5 * (L.filled - 1));
    L.looked = L.h, L.look_again = L.accepted + 20, L.h = fmin(L.h, L.cap);
  }
  for (int64_t i = 0; i < L.filled; i++) rows[5 * i] += *T;
  c->filled += L.filled, c->count += L.accepted, *h = L.h, *T += L.t;
  return status == STEPS ? FULL : status;
}

namespace {
struct Newton {
  Turns& c;
  const int m, n;  // states; of slow heat
  double *begin, *end, *expected, *kept, *kept_dT, *A, *b, *rate, *J, *V;
  int* pivots;

  Newton(Turns& turns, Arena& arena) : c(turns), m(3 + turns.p->order), n((int)turns.n) {
    begin = arena.take<double>(m), end = arena.take<double>(m), expected = arena.take<double>(m);
    kept = arena.take<double>(m * n), kept_dT = arena.take<double>(n);
    A = arena.take<double>(n * n), b = arena.take<double>(n);
    rate = arena.take<double>(m), J = arena.take<double>(m * m);
    V = arena.take<double>(m * n), pivots = arena.take<int>(n);
  }
  // M and dT from the steps of the last trace, from `begin` to `end`, which stays in the section.
  void differentiate(double* M, double* dT) {
    memset(V, 0, m * n * sizeof(double));
    for (int j = 0; j < n; j++) V[c.slow[j] * n + j] = 1;
    ring_follow(c.p, begin, c.steps, c.count, expected, V, n, c.memory);
    ring_slopes(c.p, end, 0, 0, rate, nullptr, 0, c.memory);
    for (int j = 0; j < n; j++) {
      dT[j] = -V[2 * n + j] / rate[2];
      for (int i = 0; i < m; i++) M[i * n + j] = V[i * n + j] + rate[i] * dT[j];
    }
    memcpy(kept, M, m * n * sizeof(double)), memcpy(kept_dT, dT, n * sizeof(double));
  }
  // b and its size, of the warmest state of heat.
  double step(const double* M, double warmest) {
    for (int i = 0; i < n; i++) {
      b[i] = end[c.slow[i]] - begin[c.slow[i]];
      for (int j = 0; j < n; j++) A[i * n + j] = (i == j) - M[c.slow[i] * n + j];
    }
    factorize(A, pivots, n), substitute(A, pivots, n, b);
    double size = 0;
    for (int i = 0; i < n; i++) size = fmax(size, fabs(b[i]) / warmest);
    return size;
  }
  // Broyden's update: what the last step b did beyond what was expected.
  void mend(double* M, double* dT, double T, double expected_T) const {
    double square = 0;
    for (int j = 0; j < n; j++) square += b[j] * b[j];
    for (int j = 0; j < n && square > 0; j++) {
      for (int i = 0; i < m; i++) M[i * n + j] += (end[i] - expected[i]) * b[j] / square;
      dT[j] += (T - expected_T) * b[j] / square;
    }
  }
};
}  // namespace

// The orbit of `pulses` rises near y, of about the period T: y, T, M (size x n) and dT are
// replaced. known: M and dT are a neighbour's; rough, fine: tolerances of traces far from the
// orbit and near it.
// Returns DONE, FULL, or another number where there is none.
EXPORT int64_t ring_close(Turns* turns, double* y, double* period, double* M, double* dT,
                          int pulses, int known, double rough, double fine) {
  Turns& c = *turns;
  Loop none = {};
  const int64_t step = ring_integrate(c.p, &none, 0, 0, 0, 0, 0, 0, 0);
  const int64_t more = ring_follow(c.p, 0, 0, 0, 0, 0, 8, 0) + ring_slopes(c.p, 0, 0, 0, 0, 0, 0, 0);
  Arena arena = {c.memory};
  arena.take<char>(step > more ? step : more);
  Newton newton(c, arena);
  if (!c.memory) return (int64_t)arena.used;
  const int m = newton.m, n = newton.n;
  const double guess = *period, level = y[2];
  double expected_T = 0, range = 1, moved = 0;
  bool near = false, fresh = false, mends = false;
  for (int turn = 0; turn < TURNS; turn++) {
    memcpy(newton.begin, y, m * sizeof(double)), memcpy(newton.end, y, m * sizeof(double));
    double T = 0, warmest = 1e-30, low = INFINITY, high = 0;
    const double rtol = (near ? fine : rough) * fmin(1, fmax(SMALLEST, range));
    c.filled = c.count = 0;
    for (int pulse = 0; pulse < pulses; pulse++) {
      double h = 0;
      newton.end[2] = level;
      const int status = ring_turn(&c, newton.end, 4 * guess, level, 1, rtol, &h, &T);
      if (status != EVENT) return status == FULL ? FULL : EVENT;
    }
    if (T > LONGER * guess) return EVENT;
    for (int64_t i = 0; i < c.filled; i++) {
      const double* row = c.rows + 5 * i;
      warmest = fmax(warmest, fabs(row[4])), low = fmin(low, row[3]), high = fmax(high, row[3]);
    }
    range = (high - low) / high;
    if (!known) newton.differentiate(M, dT), known = fresh = true, moved = 0;
    else if (mends) newton.mend(M, dT, T, expected_T);
    double size = newton.step(M, warmest);
    if (!fresh && (size < NEAR || turn > 0)) {
      newton.differentiate(M, dT), fresh = true, moved = 0;
      size = newton.step(M, warmest);
    }
    if (!(size < 1e3)) return EVENT;
    const bool last = near && size < CLOSED * fine && fabs(T - expected_T) < SAME * T;
    const double share = fmin(1, LARGEST / size);
    double *b = newton.b, *next = newton.expected;
    expected_T = T;
    memcpy(next, newton.end, m * sizeof(double));
    for (int j = 0; j < n; j++) {
      b[j] *= share, expected_T += dT[j] * b[j];
      for (int i = 0; i < m; i++) next[i] += M[i * n + j] * b[j];
    }
    memcpy(y, next, m * sizeof(double));
    y[2] = level, *period = fmax(expected_T, 0.2 * T), moved += size, mends = true;
    if (last) {
      if (moved > MOVED || pulses > 1) newton.differentiate(M, dT);
      memcpy(M, newton.kept, m * n * sizeof(double));
      memcpy(dT, newton.kept_dT, n * sizeof(double));
      return DONE;
    }
    if (fresh && size < NEAR) mends = near, near = true;
    else if (!near && size > LARGEST) known = false;  // too far for updates
  }
  return EVENT;
}
