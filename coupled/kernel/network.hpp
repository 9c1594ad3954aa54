// Rings that send light and heat to each other: one step, and the waves between the rings.
//
//   da_i/dt = ... + sum_j M_ij a_j + i sum_d late_id u_d(t),    u_d(t) = wave_d(t - delay_d)
//   wave_q  = sum_j seen_ring_qj a_j + sum_l seen_laser_ql s_l + sum_d seen_late_qd u_d
//
// The first waves are those at the starts of the delayed waveguides. Heat of the neighbours, slow
// against a step, is the parabola through its values at the last steps, and its error counts.
#pragma once
#include "loop.hpp"

constexpr double FOLLOW = 2.0;  // lengths of past steps that a step may span; at 1 none could grow

struct Cubic { double c[4]; };  // in the fraction of a step
inline Cubic cubic_through(double p0, double p1, double p2, double p3) {  // at 0, 1/3, 2/3, 1
  return {{p0, -5.5 * p0 + 9 * p1 - 4.5 * p2 + p3, 9 * p0 - 22.5 * p1 + 18 * p2 - 4.5 * p3,
           -4.5 * p0 + 13.5 * p1 - 13.5 * p2 + 4.5 * p3}};
}
// Signal at the fraction f of a step of a detector, dz/dt = corner (|s|^2 - z), that begins with
// `before`; x = corner h:
//   z(f) = exp(-x f) z(0) + sum_m c_m I_m,    I_m = x int_0^f e^(-x (f-u)) u^m.
// I_m = f^m - (m/x) I_(m-1) loses digits where x f is small; there it is a series.
inline double detected(const Cubic& power, double f, double before, double x) {
  const double passed = x * f;
  double total = exp(-passed) * before, integral = -expm1(-passed), f_m = 1;
  for (int m = 0; m < 4; m++, f_m *= f) {
    if (passed > 0.5) {
      if (m > 0) integral = f_m - m / x * integral;
    } else {
      double term = 1.0 / (m + 1), series = 0;
      for (int j = 0; j < 14; j++) series += term, term *= -passed / (m + 2.0 + j);
      integral = x * f_m * f * series;
    }
    total += power.c[m] * integral;
  }
  return total;
}
inline double energy(const Cubic& power, double f) {
  return f * (power.c[0] + f * (power.c[1] / 2 + f * (power.c[2] / 3 + f * power.c[3] / 4)));
}

template <class T> struct Network {
  static constexpr int B = 3, Z = 4;
  using Heat = Poles<0, T, true>;
  const Problem& p;
  Past& past;
  const int R, K, D, Q, S;  // rings, states of heat, delays, waves, stages
  const int entry;          // numbers that a past step takes
  Ring<1>* ring;
  Block<1, T>* block;
  Heat* heat;
  T *k, *kx, *z_start, *z_end, *now, *right, *dense, (*passed)[B + 2][2];
  int* pivot;
  Light lit[STAGES];
  double *nodes, *gathered;
  // Heat of the neighbours: before and after the step, and its error; at the last steps, newest
  // first, with divided differences.
  T *before, *after, *error, *values, *first, *second;
  double *times, *known;

  Network(const Problem& problem, Past& history, Arena& arena)
      : p(problem), past(history), R(p.rings), K(p.order), D(p.delays), Q(p.waves),
        S(p.method.stages), entry(3 + 8 * p.delays) {
    ring = arena.take<Ring<1>>(R), block = arena.take<Block<1, T>>(R), heat = arena.take<Heat>(R);
    k = arena.take<T>(STAGES * R * Z), kx = arena.take<T>(STAGES * R * K);
    z_start = arena.take<T>(R), z_end = arena.take<T>(R);
    now = arena.take<T>(R * Z), right = arena.take<T>(R * Z), passed = arena.take<T[B + 2][2]>(R);
    const size_t n = p.light == LOOPS ? R * B : 0;
    dense = arena.take<T>(n * n), pivot = arena.take<int>(n);
    for (int i = 0; i < R; i++) {
      const Heat own(p, i, kx, arena);
      if (arena.base) heat[i] = own, ring[i] = ring_of<1>(p, i);
    }
    for (Light& one : lit) one = light_of(arena, R);
    nodes = arena.take<double>(8 * Q), gathered = arena.take<double>(2 * Q);
    before = arena.take<T>(R), after = arena.take<T>(R), error = arena.take<T>(R);
    values = arena.take<T>(3 * R), first = arena.take<T>(R), second = arena.take<T>(R);
    times = arena.take<double>(3), known = arena.take<double>(1);
  }
  int gathers() const { return (p.energies ? Q : 0) + (p.corner ? Q : 0); }
  int width() const { return 2 * Q + gathers(); }

  void begin(const T* y, bool fresh, double t) {
    for (int i = 0; i < R; i++)
      z_start[i] = z_end[i] = heat[i].temperature(y + R * B + i * K);
    if (!fresh) return;
    memset(nodes, 0, 8 * Q * sizeof(double)), memset(gathered, 0, 2 * Q * sizeof(double));
    T* const rises[] = {before, error, values, first, second};
    for (T* one : rises) memset(one, 0, R * sizeof(T));
    past.filled = 0, known[0] = times[0] = times[1] = times[2] = 0;
    neighbours(y, before);
    memcpy(after, before, R * sizeof(T));
    remember(t);
  }

  // ---- heat of the neighbours ------------------------------------------------------------------

  void neighbours(const T* y, T* rise) const {
    const int n = R * K;
    for (int i = 0; i < R && p.cross; i++) {
      const double* c = p.cross + i * n;
      T sum = zero<T>();
      for (int m = 0; m < n; m++) sum += c[m] * y[R * B + m];
      rise[i] = sum;
    }
  }
  void remember(double t) {  // the values after the step
    memmove(times + 1, times, 2 * sizeof(double)), memmove(values + R, values, 2 * R * sizeof(T));
    times[0] = t, memcpy(values, after, R * sizeof(T));
    known[0] = fmin(known[0] + 1, 3);
    for (int i = 0; i < R && known[0] > 1; i++) {  // divided differences
      first[i] = (values[i] - values[R + i]) * (1 / (times[0] - times[1]));
      if (known[0] < 3) continue;
      const T earlier = (values[R + i] - values[2 * R + i]) * (1 / (times[1] - times[2]));
      second[i] = (first[i] - earlier) * (1 / (times[0] - times[2]));
    }
  }
  T extrapolated(int i, double t) const {
    const double u = t - times[0];
    return values[i] + first[i] * u + second[i] * (u * (t - times[1]));
  }
  double missed(int i) const { return value(error[i]); }
  double other(int i) const { return value(before[i]); }
  double other_at(double x, int i) const {
    return (1 - x) * value(before[i]) + x * value(after[i]);
  }
  double heat_error(int i) const { return heat[i].error(); }

  // ---- waves -----------------------------------------------------------------------------------

  int past_step(double t) const {  // the one that holds t
    return piece_of((int)past.filled, t, [&](int k) { return past.steps[k * entry]; });
  }
  // The wave behind a delay at t, and its slope; at a front that of the side of `aside`. 0 before
  // the start.
  void delayed(int d, double t, double aside, double* wave, double* rising) const {
    const double at = t - p.delay[d];
    wave[0] = wave[1] = rising[0] = rising[1] = 0;
    if (past.filled == 0 || at + aside < past.steps[0]) return;
    const double* step = past.steps + past_step(at + aside) * entry;
    for (int m = 0; m < 2; m++) {
      const double *c = step + 3 + 8 * d + 4 * m, x = (at - step[0]) / step[1];
      wave[m] = polynomial(c, 4, x), rising[m] = slope(c, 4, x) / step[1];
    }
  }
  // How much of h a step from t may take to resolve what the delays bring: `FOLLOW` times as long
  // as the past steps that it reads, or to where a shorter one begins.
  double resolved(double t, double h) const {
    for (int d = 0; d < D; d++) {
      const double at = t - p.delay[d];
      for (int m = past.filled ? past_step(at) : 0; m < past.filled; m++) {
        const double* step = past.steps + m * entry;
        if (step[0] >= at + h) break;
        h = fmin(h, fmax(FOLLOW * step[2], step[0] - at));
      }
    }
    return h;
  }
  // The observed waves at t; `states`, R x Z, begin with the field of each ring.
  void waves(const Places& places, double t, double aside, const double* states,
             double* out) const {
    memset(out, 0, 2 * Q * sizeof(double));
    double wave[2], rising[2];
    for (int q = 0; q < Q; q++)
      for (int i = 0; i < R; i++) {
        const double* e = p.seen_ring + 2 * (q * R + i);
        if (e[0] != 0 || e[1] != 0)  // most see one ring
          add_product(out + 2 * q, e, states + Z * i);
      }
    for (int l = 0; l < p.lasers; l++) {
      laser_at(p, places, l, t, wave, rising);
      for (int q = 0; q < Q; q++)
        add_product(out + 2 * q, p.seen_laser + 2 * (q * p.lasers + l), wave);
    }
    for (int d = 0; d < D; d++) {
      delayed(d, t, aside, wave, rising);
      for (int q = 0; q < Q; q++) add_product(out + 2 * q, p.seen_late + 2 * (q * D + d), wave);
    }
  }
  Cubic power(int q) const {  // of a wave over the step
    double P[4];
    for (int j = 0; j < 4; j++) {
      const double* n = nodes + 2 * (j * Q + q);
      P[j] = n[0] * n[0] + n[1] * n[1];
    }
    return cubic_through(P[0], P[1], P[2], P[3]);
  }
  // Energies of the waves so far, if wanted, then signals of detectors, at the fraction f.
  void gather(double f, double h, double* out) const {
    const int energies = p.energies ? Q : 0;
    for (int q = 0; q < energies; q++) out[q] = gathered[q] + h * energy(power(q), f);
    for (int q = 0; q < Q && p.corner; q++) {
      const double x = p.corner[q] * h;
      out[energies + q] = x > 0 ? detected(power(q), f, gathered[energies + q], x) : 0;
    }
  }
  void observe(const Places& places, double x, double t, double h, const double* states,
               double* out) const {
    waves(places, t, (1 - 2 * x) * p.hair, states, out);
    if (gathers()) gather(x, h, out + 2 * Q);
  }
  // The step from t is accepted: its waves at thirds, for energies, detectors and delays.
  template <class At> void note(const Places& places, double t, double h, const At& at) {
    for (int j = 0; j < 4 && (D || gathers()); j++) {
      for (int i = 0; i < R; i++) at(j / 3.0, i, (double*)right + Z * i);
      waves(places, t + j / 3.0 * h, (1 - 2 * j / 3.0) * p.hair, (double*)right, nodes + 2 * j * Q);
    }
  }
  void accept(double t, double h, double planned, double until) {  // after rows were kept
    double* step = past.steps + past.filled * entry;
    if (D) {
      step[0] = t, step[1] = h, step[2] = fmax(h, planned), past.filled++;
      for (int d = 0; d < D; d++)
        for (int m = 0; m < 2; m++) {
          const double* n = nodes + 2 * d + m;
          const Cubic c = cubic_through(n[0], n[2 * Q], n[4 * Q], n[6 * Q]);
          memcpy(step + 3 + 8 * d + 4 * m, c.c, sizeof c.c);
        }
    }
    if (gathers()) gather(1, h, gathered);
    if (!p.cross) return;
    remember(until);
    memcpy(before, after, R * sizeof(T));
  }
  // ---- the step --------------------------------------------------------------------------------

  // The light of the stages with what delays bring.
  const Light* shine(double t, double h, const Light* light) {
    for (int q = 0; q < S && D; q++) {
      const double at = t + p.method.at[q] * h, aside = (1 - 2 * p.method.at[q]) * p.hair;
      memcpy(lit[q].in, light[q].in, 4 * R * sizeof(double));  // and their slopes, which follow
      memcpy(lit[q].detuning, light[q].detuning, 2 * R * sizeof(double));
      for (int d = 0; d < D; d++) {
        double wave[2], rising[2];
        delayed(d, at, aside, wave, rising);
        for (int i = 0; i < R; i++) {
          const double* e = p.late + 2 * (i * D + d);
          add_product(lit[q].in + 2 * i, e, wave), add_product(lit[q].in_slope + 2 * i, e, rising);
        }
      }
    }
    return D ? lit : light;
  }
  bool step(const T* y, double t, double h, const Light* given, T* out) {
    const Light* light = shine(t, h, given);
    const double s = 1 / (p.method.gamma * h), per_h = 1 / h;
    for (int i = 0; i < R; i++) {
      const T* x = y + R * B + i * K;
      block[i].linearize(ring[i], y + i * B, heat[i].temperature(x), extrapolated(i, t),
                         light[0].detuning + i);
      heat[i].start(x, s, block[i].P);
      block[i].eliminate_heat(s, heat[i].G);
      if (p.light == LOOPS) continue;
      invert(block[i].matrix);
      for (int m = 0; m < B; m++) {
        const T* row = block[i].matrix[m];
        const double* taken = p.taken + 2 * i;
        passed[i][m][0] = taken[0] * row[0] + taken[1] * row[1];
        passed[i][m][1] = taken[0] * row[1] - taken[1] * row[0];
      }
      for (int m = 0; m < 2; m++) {
        const double* sent = p.sent + 2 * i;
        passed[i][B][m] = sent[0] * passed[i][0][m] - sent[1] * passed[i][1][m];
        passed[i][B + 1][m] = sent[0] * passed[i][1][m] + sent[1] * passed[i][0][m];
      }
    }
    if (p.light == LOOPS) fill();
    for (int q = 0; q < S; q++) {
      const double* a = p.method.a + q * S;
      double c[STAGES], g = p.method.slope[q] * h;
      T f[B];
      for (int j = 0; j < q; j++) c[j] = p.method.c[q * S + j] * per_h;
      for (int i = 0; i < R; i++) {
        T *o = now + i * Z, *r = right + i * Z;
        combine<Z>(q, a, c, k + i * Z, R * Z, block[i].start, o, r);
        const T rise = p.cross ? extrapolated(i, t + p.method.at[q] * h) : zero<T>();
        const T P = block[i].stage(q, ring[i], o, rise, light[q].detuning + i, f);
        r[B] = heat[i].stage(q, a, c, P);
        T push = r[B];  // of the heat; a change of the neighbours' in time is one of dT, not of z
        if (p.cross)
          push += (first[i] + second[i] * (t - times[1])) * g
                  / (1.0 + (2 * ring[i].bend) * block[i].start[B]);
        for (int m = 0; m < B; m++) r[m] += f[m] + block[i].u[m] * push;
        block[i].shine(light[q], light[0], i, g, block[i].start, r);
      }
      if (p.light == LOOPS) solve_loops(); else solve_along_bus();
      for (int i = 0; i < R; i++) {
        T *r = right + i * Z, feedback = zero<T>();
        for (int m = 0; m < B; m++) feedback += block[i].w[m] * r[m];
        heat[i].feed(q, feedback);
        r[B] += feedback * heat[i].G;
      }
      memcpy(k + q * R * Z, right, R * Z * sizeof(T));
    }
    for (int i = 0; i < R; i++) {
      const T *o = now + i * Z, *last = right + i * Z;
      for (int m = 0; m < B; m++) out[i * B + m] = o[m] + last[m];
      z_start[i] = block[i].start[B], z_end[i] = o[B] + last[B];
      heat[i].finish(p.method.a + (S - 1) * S, out + R * B + i * K);
    }
    neighbours(out, after);
    for (int i = 0; i < R && p.cross; i++) error[i] = after[i] - extrapolated(i, t + h);
    return true;
  }
  // Along the bus, where M_ij = taken_i sent_j, a ring gets the fields of those before it, and their
  // changes, as one wave, of which a ring and what it sends are linear functions (`passed`): all
  // but that product is done before the wave arrives.
  void solve_along_bus() {
    T wave[2] = {zero<T>(), zero<T>()};
    for (int at = 0; at < R; at++) {
      const int i = p.sequence[at];
      T *r = right + i * Z, x[B + 2];  // the last two: what it sends
      for (int m = 0; m < B; m++) {
        x[m] = zero<T>();
        for (int l = 0; l < B; l++) x[m] += block[i].matrix[m][l] * r[l];
      }
      const T field[2] = {now[i * Z] + x[0], now[i * Z + 1] + x[1]};
      x[B] = x[B + 1] = zero<T>();
      add_product(x + B, p.sent + 2 * i, field);
      for (int m = 0; m < B + 2; m++)
        x[m] += passed[i][m][0] * wave[0] + passed[i][m][1] * wave[1];
      wave[0] += x[B], wave[1] += x[B + 1];
      memcpy(r, x, B * sizeof(T));
    }
  }
  void fill() {  // the matrix of all rings
    const int n = R * B;
    for (int i = 0; i < n * n; i++) dense[i] = zero<T>();
    for (int i = 0; i < R; i++)
      for (int j = 0; j < R; j++) {
        T* a = dense + i * B * n + j * B;
        for (int m = 0; m < B && i == j; m++)
          for (int l = 0; l < B; l++) a[m * n + l] = block[i].matrix[m][l];
        if (i == j) continue;
        const double* M = p.between + 2 * (i * R + j);
        a[0] -= zero<T>() + M[0], a[1] += zero<T>() + M[1];
        a[n] -= zero<T>() + M[1], a[n + 1] -= zero<T>() + M[0];
      }
    factorize(dense, pivot, n);
  }
  void solve_loops() {
    T* x = k + (S - 1) * R * Z;  // free until the last stage is written
    for (int i = 0; i < R; i++) {
      T* r = right + i * Z;
      for (int j = 0; j < R; j++)
        if (j != i) add_product(r, p.between + 2 * (i * R + j), now + j * Z);
      for (int m = 0; m < B; m++) x[i * B + m] = r[m];
    }
    substitute(dense, pivot, R * B, x);
    for (int i = 0; i < R; i++) for (int m = 0; m < B; m++) right[i * Z + m] = x[i * B + m];
  }
};
