// Rings that send light and heat to each other: one step, and the waves between the rings.
//
//   da_i/dt = ... + sum_j M_ij a_j + i sum_d late_id u_d(t),    u_d(t) = wave_d(t - delay_d)
//   wave_q  = sum_j seen_ring_qj a_j + sum_l seen_laser_ql s_l + sum_d seen_late_qd u_d
//
// The first waves are those at the starts of the delayed waveguides. Heat of the neighbours, slow against a step, is
// the parabola through its values at the last steps, and its error counts.
#pragma once
#include "loop.hpp"

constexpr double FOLLOW = 2.0;  // lengths of past steps that a step may span; at 1 none could grow
constexpr double LONG_AGO = -1e200;  // ns: since then heat has been what it is at the start
// The cubic in the fraction of a step through p at 0, 1/3, 2/3 and 1, `apart` numbers apart.
inline void cubic_through(const double* p, int apart, double* c) {
  const double p0 = p[0], p1 = p[apart], p2 = p[2 * apart], p3 = p[3 * apart];
  c[0] = p0, c[1] = -5.5 * p0 + 9 * p1 - 4.5 * p2 + p3;
  c[2] = 9 * p0 - 22.5 * p1 + 18 * p2 - 4.5 * p3;
  c[3] = -4.5 * p0 + 13.5 * p1 - 13.5 * p2 + 4.5 * p3;
}
// z at the fraction f of a step that begins with `before`, dz/df = gain P - x z: by its power series (16 terms leave
// 1e-18) or, where that is long, by the cubic that solves the equation and what decays to it. Energies have x = 0,
// detectors gain = x = corner h.
inline double gathered_at(const double* P, double gain, double x, double f, double before) {
  double cubic[5] = {0, 0, 0, 0, 0}, sum = before, term = before, f_m = f;
  if (x * f > 0.5) {
    for (int m = 4; m-- > 0;) cubic[m] = (gain * P[m] - (m + 1) * cubic[m + 1]) / x;
    return polynomial(cubic, 4, f) + exp(-x * f) * (before - cubic[0]);
  }
  for (int m = 0; m < (x > 0 ? 16 : 4); m++, f_m *= f) {
    term = ((m < 4 ? gain * P[m] * f_m : 0) - x * f * term) / (m + 1);
    sum += term;
  }
  return sum;
}

template <class T> struct Network {
  static constexpr int F = 1, B = 3, Z = 4;
  const Problem& p;
  Past& past;
  const int R, K, D, Q, S;  // rings, states of heat, delays, waves, stages
  const int entry;          // numbers that a past step takes
  Ring<1>* ring;
  Poles<T>* heat;
  Block<1, T, Poles<T>>* block;
  T *k, *kx, *z_start, *z_end, *now, *right, *dense;
  int* pivot;
  double *nodes, *gathered;
  Dual<1>* brought;
  // heat of the neighbours after the step; the parabola through that at the last steps, newest first (differences)
  T *after, *values, *first, *second;
  double* times;
  Network(const Problem& problem, Past& history, Arena& arena)
      : p(problem), past(history), R(p.rings), K(p.order), D(p.delays), Q(p.waves),
        S(p.method.stages), entry(3 + 8 * p.delays) {
    ring = arena.take<Ring<1>>(R), heat = arena.take<Poles<T>>(R);
    block = arena.take<Block<1, T, Poles<T>>>(R);
    k = arena.take<T>(STAGES * R * Z), kx = arena.take<T>(STAGES * R * K);
    z_start = arena.take<T>(R), z_end = arena.take<T>(R);
    now = arena.take<T>(R * Z), right = arena.take<T>(R * Z);
    const size_t n = p.light == LOOPS ? R * B : 0;
    dense = arena.take<T>(n * n), pivot = arena.take<int>(n);
    nodes = arena.take<double>(10 * Q), gathered = nodes + 8 * Q, times = arena.take<double>(3);
    brought = arena.take<Dual<1>>(STAGES * 2 * R);
    after = arena.take<T>(4 * R), values = after + R, first = values + R, second = first + R;
    for (int i = 0; i < R; i++) {
      const Poles<T> own(p, i, kx, arena);
      if (!arena.base) continue;
      ring[i] = ring_of<1>(p, i), heat[i] = own, block[i].ring = ring + i, block[i].heat = heat + i;
    }
  }
  int gathers() const { return (p.energies ? Q : 0) + (p.corner ? Q : 0); }
  int width() const { return 2 * Q + gathers(); }

  void begin(const T* y, bool fresh, double t) {
    for (int i = 0; i < R; i++) z_start[i] = z_end[i] = heat[i].temperature(y + R * B + i * K);
    if (!fresh) return;
    memset(nodes, 0, 10 * Q * sizeof(double)), memset(after, 0, 4 * R * sizeof(T));
    past.filled = 0, times[0] = times[1] = times[2] = LONG_AGO;
    neighbours(y);
    remember(t);
  }
  void neighbours(const T* y) {  // their heat
    for (int i = 0; i < R && p.cross; i++) {
      after[i] = zero<T>();
      for (int m = 0; m < R * K; m++) after[i] += p.cross[i * R * K + m] * y[R * B + m];
    }
  }
  void remember(double t) {  // the values after the step
    const double lasted = t - times[0], both = t - times[1];
    memmove(times + 1, times, 2 * sizeof(double)), times[0] = t;
    for (int i = 0; i < R; i++) {
      const T rate = (after[i] - values[i]) * (1 / lasted);
      second[i] = (rate - first[i]) * (1 / both);
      first[i] = rate, values[i] = after[i];
    }
  }
  T extrapolated(int i, double t) const {
    const double u = t - times[0];
    return values[i] + first[i] * u + second[i] * (u * (t - times[1]));
  }
  double other(double x, int i) const { return (1 - x) * value(values[i]) + x * value(after[i]); }
  double heat_error(int i, double until) const {
    return heat[i].error() + magnitude(after[i] - extrapolated(i, until));
  }
  int64_t past_step(double t) const {  // the one that holds t; the first where t lies before all
    int64_t low = 0, high = past.filled - 1;
    while (low < high) {
      const int64_t middle = (low + high + 1) / 2;
      if (past.steps[middle * entry] <= t) low = middle; else high = middle - 1;
    }
    return low;
  }
  // The wave behind a delay at t; at a front that of the side of `aside`. 0 before the start.
  void delayed(int d, double t, double aside, Dual<1>* wave) const {
    const double at = t - p.delay[d];
    wave[0] = wave[1] = zero<Dual<1>>();
    if (past.filled == 0 || at + aside < past.steps[0]) return;
    const double* step = past.steps + past_step(at + aside) * entry;
    const Dual<1> x = {(at - step[0]) / step[1], {1 / step[1]}};
    for (int m = 0; m < 2; m++) wave[m] = polynomial(step + 3 + 8 * d + 4 * m, 4, x);
  }
  // How much of h a step from t may take to resolve what the delays bring: `FOLLOW` times as long as the past steps
  // that it reads, or to where a shorter one begins.
  double resolved(double t, double h) const {
    for (int d = 0; d < D; d++) {
      const double at = t - p.delay[d];
      for (int64_t m = past_step(at); m < past.filled; m++) {
        const double* step = past.steps + m * entry;
        if (step[0] >= at + h) break;
        h = fmin(h, fmax(FOLLOW * step[2], step[0] - at));
      }
    }
    return h;
  }
  // The observed waves at t; `states`, R x Z, begin with the field of each ring.
  void waves(int piece, double t, double aside, const double* states, double* out) const {
    memset(out, 0, 2 * Q * sizeof(double));
    for (int q = 0; q < Q; q++)
      for (int i = 0; i < R; i++) {
        const double* e = p.seen_ring + 2 * (q * R + i);
        if (e[0] != 0 || e[1] != 0) add_product(out + 2 * q, e, states + Z * i);  // most see one ring
      }
    for (int l = 0; l < p.lasers + D; l++) {  // lasers, then what delays bring
      Dual<1> wave[2];
      const int d = l - p.lasers;
      if (d < 0) laser_at(p, piece, l, t, wave); else delayed(d, t, aside, wave);
      const double *seen = d < 0 ? p.seen_laser + 2 * l : p.seen_late + 2 * d;
      const double values[2] = {wave[0].v, wave[1].v};
      for (int q = 0; q < Q; q++) add_product(out + 2 * q, seen + 2 * q * (d < 0 ? p.lasers : D), values);
    }
  }
  // Energies of the waves so far, if wanted, then signals of detectors, at the fraction f.
  void gather(double f, double h, double* out) const {
    for (int m = 0; m < gathers(); m++) {
      const bool energy = p.energies && m < Q;
      const double x = energy ? 0 : p.corner[m % Q] * h;
      double P[4], cubic[4];  // power of the wave over the step
      for (int j = 0; j < 4; j++) {
        const double* n = nodes + 2 * (j * Q + m % Q);
        P[j] = n[0] * n[0] + n[1] * n[1];
      }
      cubic_through(P, 1, cubic);
      out[m] = gathered_at(cubic, energy ? h : x, x, f, gathered[m]);
    }
  }
  void observe(int piece, double x, double t, double h, const double* states, double* out) const {
    waves(piece, t, (1 - 2 * x) * p.time_tolerance, states, out);
    gather(x, h, out + 2 * Q);
  }
  // The step from t is accepted: its waves at thirds, for energies, detectors and delays.
  template <class At> void note(int piece, double t, double h, const At& at) {
    for (int j = 0; j < 4 && (D || gathers()); j++) {
      for (int i = 0; i < R; i++) at(j / 3.0, i, (double*)right + Z * i);
      const double aside = (1 - 2 * j / 3.0) * p.time_tolerance;
      waves(piece, t + j / 3.0 * h, aside, (double*)right, nodes + 2 * j * Q);
    }
  }
  void accept(double t, double h, double planned, double until) {  // after rows were kept
    double* step = past.steps + past.filled * entry;
    if (D) {
      step[0] = t, step[1] = h, step[2] = fmax(h, planned), past.filled++;
      for (int m = 0; m < 2 * D; m++) cubic_through(nodes + m, 2 * Q, step + 3 + 4 * m);
    }
    gather(1, h, gathered);
    if (p.cross) remember(until);
  }
  // Not a part of `step`, whose loop over the rings would be slower.
  __attribute__((noinline)) void prepare(int i, const T* y, double t, double h, const Dual<1>* detuning) {
    const double s = 1 / (p.method.gamma * h);
    block[i].linearize(y + i * B, y + R * B + i * K, extrapolated(i, t), detuning, s);
    if (p.light != LOOPS) invert(block[i].matrix);
  }
  bool step(const T* y, double t, double h, const Light* light, T* out) {
    Light lit[STAGES];  // with what delays bring
    for (int q = 0; q < S && D; q++) {
      lit[q] = {brought + 2 * R * q, light[q].detuning};
      memcpy(lit[q].in, light[q].in, 2 * R * sizeof *brought);
      for (int d = 0; d < D; d++) {
        Dual<1> wave[2];
        delayed(d, t + p.method.at[q] * h, (1 - 2 * p.method.at[q]) * p.time_tolerance, wave);
        for (int i = 0; i < R; i++) add_product(lit[q].in + 2 * i, p.late + 2 * (i * D + d), wave);
      }
    }
    if (D) light = lit;
    for (int i = 0; i < R; i++) prepare(i, y, t, h, light[0].detuning + i);
    if (p.light == LOOPS) fill();
    for (int q = 0; q < S; q++) {
      const Stage stage(p.method, S, q, h);
      for (int i = 0; i < R; i++) {
        T* r = right + i * Z;
        const T rise = p.cross ? extrapolated(i, t + stage.at) : zero<T>();
        block[i].right_hand_side(stage, k + i * Z, R * Z, light, i, rise, now + i * Z, r);
        if (!p.cross) continue;
        const T slope = 1.0 + (2 * ring[i].bend) * block[i].start[B];  // of dT by z
        const T push = (first[i] + second[i] * (t - times[1])) * stage.slope / slope;
        for (int m = 0; m < B; m++) r[m] += block[i].u[m] * push;
      }
      if (p.light == LOOPS) solve_loops(); else solve_along_bus();
      for (int i = 0; i < R; i++) block[i].back_substitute(q, right + i * Z);
      memcpy(k + q * R * Z, right, R * Z * sizeof(T));
    }
    const Stage last(p.method, S, S - 1, h);
    for (int i = 0; i < R; i++)
      block[i].finish(last, now + i * Z, right + i * Z, out + i * B, out + R * B + i * K, z_start + i, z_end + i);
    neighbours(out);
    return true;
  }
  // Along the bus, where M_ij = taken_i sent_j, a ring gets the fields before it, and their changes, as one wave.
  void solve_along_bus() {
    T wave[2] = {zero<T>(), zero<T>()};
    for (int at = 0; at < R; at++) {
      const int i = p.sequence[at];
      T *r = right + i * Z, x[B];
      add_product(r, p.taken + 2 * i, wave);
      block[i].solve(r, x);
      const T field[2] = {now[i * Z] + x[0], now[i * Z + 1] + x[1]};
      add_product(wave, p.sent + 2 * i, field);
      memcpy(r, x, B * sizeof(T));
    }
  }
  void fill() {  // the matrix of all rings
    for (int i = 0; i < R; i++) for (int j = 0; j < R; j++) {
        const double* M = p.between + 2 * (i * R + j);
        const double light[B][B] = {{M[0], -M[1], 0}, {M[1], M[0], 0}, {0, 0, 0}};
        for (int m = 0; m < B; m++)
          for (int l = 0; l < B; l++)
            dense[(i * B + m) * R * B + j * B + l] = (i == j ? block[i].matrix[m][l] : zero<T>()) - light[m][l];
      }
    factorize(dense, pivot, R * B);
  }
  void solve_loops() {
    T* x = k + (S - 1) * R * Z;  // free until the last stage is written
    for (int i = 0; i < R; i++) {
      for (int j = 0; j < R; j++) add_product(right + i * Z, p.between + 2 * (i * R + j), now + j * Z);
      memcpy(x + i * B, right + i * Z, B * sizeof(T));
    }
    substitute(dense, pivot, R * B, x);
    for (int i = 0; i < R; i++) memcpy(right + i * Z, x + i * B, B * sizeof(T));
  }
};
