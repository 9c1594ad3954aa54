// One Rosenbrock step, (1/(gamma h) - J) k_i = f(y + sum_j a_ij k_j) + sum_j (c_ij/h) k_j.
//
// J comes from `optics` on dual numbers. Heat is eliminated: with s = 1/(gamma h), w = dP/d(a, N),
// u = d(da/dt)/dz, and r what a stage asks of each state,
//
//   k_x = (r_x + gain (w.k_o))/(s + rate)
//   (s - J_o - G u w^T) k_o = r_o + u sum_i r_i/(s + rate_i),    G = sum_i gain_i/(s + rate_i)
//
// so whatever the number of poles, light and carriers of a ring are B = 2 F + 1 unknowns.
// Source: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), Section IV.7.
#pragma once
#include "equations.hpp"
#define INLINE __attribute__((always_inline)) inline
#define INLINE_LAMBDA __attribute__((always_inline))
constexpr int STAGES = 8;  // at most

struct Arena {  // hands out the caller's memory; without any it counts what is needed
  char* base;
  size_t used = 0;
  template <class X> X* take(size_t n) {
    X* x = base ? (X*)(base + used) : nullptr;
    used += (n * sizeof(X) + 63) / 64 * 64;
    return x;
  }
};
inline Light light_of(Arena& arena, int n) { return {arena.take<Dual<1>>(2 * n), arena.take<Dual<1>>(n)}; }  // fields
struct Stage {  // the coefficients of one stage of a step of h
  int number;
  double a[STAGES], c[STAGES], at, slope;
  INLINE Stage(const Method& m, int count, int q, double h)
      : number(q), at(m.at[q] * h), slope(m.slope[q] * h) {
    const double per_h = 1 / h;
    for (int j = 0; j < q; j++) a[j] = m.a[q * count + j], c[j] = m.c[q * count + j] * per_h;
  }
};

// x^p near x0, where y0 = x0^p: series of log and exp in short chains (Estrin).
template <class T> inline T near_power(const T& x, double p, const T& x0, const T& y0) {
  const T s = (x - x0) / (x + x0), b = s * s;
  if (value(b) > 0.01) return y0 * power(x / x0, p);
  const T b2 = b * b, high = 1 / 5. + b * (1 / 7.) + b2 * (1 / 9. + b * (1 / 11.) + b2 * (1 / 13.));
  const T l = (2 * p) * s * ((1.0 + b * (1 / 3.)) + b2 * high), l2 = l * l, l4 = l2 * l2;
  const T few = (1.0 + l) + l2 * (0.5 + l * (1 / 6.));
  const T more = (1 / 24. + l * (1 / 120.)) + l2 * (1 / 720. + l * (1 / 5040.));
  return y0 * (few + l4 * (more + l4 * (1 / 40320.)));
}

template <class T> inline void invert(T (&m)[3][3]) {  // by cofactors; s keeps it well conditioned
  T r[3][3];
#pragma GCC unroll 3
  for (int i = 0; i < 3; i++)
#pragma GCC unroll 3
    for (int j = 0; j < 3; j++) {
      const int k = (j + 1) % 3, l = (j + 2) % 3, a = (i + 1) % 3, b = (i + 2) % 3;
      r[i][j] = m[k][a] * m[l][b] - m[k][b] * m[l][a];
    }
  const T d = 1.0 / (m[0][0] * r[0][0] + m[0][1] * r[1][0] + m[0][2] * r[2][0]);
  for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) m[i][j] = d * r[i][j];
}
// Triangular factors of A, n x n, in its place; returns whether det A > 0.
template <class T> inline bool factorize(T* A, int* order, int n) {
  bool positive = true;
  for (int j = 0; j < n; j++) {
    int pivot = j;
    for (int i = j + 1; i < n; i++)
      if (magnitude(A[i * n + j]) > magnitude(A[pivot * n + j])) pivot = i;
    order[j] = pivot;
    if (pivot != j)
      for (int k = 0; k < n; k++) { T x = A[j * n + k]; A[j * n + k] = A[pivot * n + k]; A[pivot * n + k] = x; }
    positive ^= (pivot != j) ^ (value(A[j * n + j]) < 0);
    const T d = 1.0 / A[j * n + j];
    for (int i = j + 1; i < n; i++) {
      const T f = A[i * n + j] = A[i * n + j] * d;
      if (value(f) == 0) continue;
      for (int k = j + 1; k < n; k++) A[i * n + k] -= f * A[j * n + k];
    }
  }
  return positive;
}
template <class T> inline void substitute(const T* A, const int* order, int n, T* x) {
  for (int j = 0; j < n; j++) { T o = x[j]; x[j] = x[order[j]]; x[order[j]] = o; }
  for (int i = 0; i < n; i++) for (int j = 0; j < i; j++) x[i] -= A[i * n + j] * x[j];
  for (int i = n; i-- > 0;) {
    for (int j = i + 1; j < n; j++) x[i] -= A[i * n + j] * x[j];
    x[i] = x[i] / A[i * n + i];
  }
}
template <int B, class T> inline void invert(T (&m)[B][B]) {  // rows solve the transposed system
  T factors[B][B];
  int order[B];
  for (int i = 0; i < B; i++) for (int j = 0; j < B; j++) factors[j][i] = m[i][j];
  factorize(factors[0], order, B);
  for (int i = 0; i < B; i++) {
    for (int j = 0; j < B; j++) m[i][j] = zero<T>() + (i == j);
    substitute(factors[0], order, B, m[i]);
  }
}

// Heat of one ring in a step: dx/dt = A x + H[x, x] + (G x + B) P,  k_x = M^-1 (r_x + b w.k_o),  b = G x + B,
// M = s - A - 2 H[x, .] - G P; of poles, dx/dt = gain P - rate x, M is s + rate and b the gain. An L-stable step damps
// a mode that grows faster than s, and its error does not show it; without one det M > 0.
template <class T, class Real, int kind> struct Heating {
  int n, row, last;  // states; how far the stages are apart in k; the last one
  const Problem* p;
  const double *read, *weight, *gain, *rate;
  double* damp;      // 1/(s + rate)
  Real *b, G;        // M^-1 b, and the z of it
  T *k, *x, *M;      // stages; the state at a stage
  const T* x0;       // the state at the start
  int* order;
  Heating(const Problem& problem, int ring, T* kx, Arena& arena)
      : n(problem.order), row(problem.rings * n), last(problem.method.stages - 1), p(&problem),
        read(p->read + ring * n), weight(p->weight + ring * n), gain(p->gain + ring * n),
        rate(p->rate + ring * n), k(kx + ring * n) {
    const int square = kind == QUADRATIC ? n * n : 0;
    damp = arena.take<double>(n), b = arena.take<Real>(n), x = arena.take<T>(n);
    M = arena.take<T>(square), order = arena.take<int>(square);
  }
  template <class X> INLINE X temperature(const X* state) const {
    X z = zero<X>();
    for (int i = 0; i < n; i++) z += read[i] * state[i];
    return z;
  }
  bool start(const T* state, double s, const T& P) {  // false: a mode grows too fast for the step
    bool follows = true;
    x0 = state;
    if constexpr (kind == POLES) {
      for (int i = 0; i < n; i++) damp[i] = 1 / (s + rate[i]), b[i] = gain[i] * damp[i];
    } else {
      for (int i = 0; i < n; i++) {
        b[i] = zero<T>() + p->B[i];
        for (int j = 0; j < n; j++) {
          M[i * n + j] = (i == j ? s : 0) - quadratic(*p, i, j, 2, state, P);
          b[i] += p->G[i * n + j] * state[j];
        }
      }
      follows = factorize(M, order, n), substitute(M, order, n, b);
    }
    G = temperature(b);
    return follows;
  }
  // A stage under the power P: its z, without what comes back from light and carriers.
  INLINE T stage(const Stage& stage, const T& P) const {
    const double *__restrict g = gain, *__restrict r = rate, *__restrict d = damp;
    const double* __restrict seen = read;
    const T *__restrict before = k, *__restrict start = x0;
    T* __restrict now = k + stage.number * row;
    T back = zero<T>();
    for (int i = 0; i < n; i++) {
      T y = start[i], sum = zero<T>();
      for (int j = 0; j < stage.number; j++)
        y += stage.a[j] * before[j * row + i], sum += stage.c[j] * before[j * row + i];
      if constexpr (kind == QUADRATIC) {
        x[i] = y, now[i] = sum + p->B[i] * P;
      } else {
        now[i] = y = (sum - r[i] * y + g[i] * P) * d[i];
        back += seen[i] * y;
      }
    }
    if constexpr (kind == QUADRATIC) {
      for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) now[i] += quadratic(*p, i, j, 1, x, P) * x[j];
      substitute(M, order, n, now);
      back = temperature(now);
    }
    return back;
  }
  INLINE void add_feedback(int q, const T& power) const {
    const Real* __restrict each = b;
    T* __restrict now = k + q * row;
    for (int i = 0; i < n; i++) now[i] += each[i] * power;
  }
  INLINE void finish(const Stage& last, T* __restrict out) const {
    const T *__restrict all = k, *__restrict start = x0;
    for (int i = 0; i < n; i++) {
      T y = start[i] + all[last.number * row + i];
      for (int j = 0; j < last.number; j++) y += last.a[j] * all[j * row + i];
      out[i] = y;
    }
  }
  double error() const {
    double e = 0;
    for (int i = 0; i < n; i++) e += weight[i] * magnitude(k[last * row + i]);
    return e;
  }
};
template <class T> using Poles = Heating<T, double, POLES>;
template <class T> using Quadratic = Heating<T, T, QUADRATIC>;

template <int F, class T, class Heat> struct Block {  // light and carriers of one ring in a step
  static constexpr int B = 2 * F + 1, Z = B + 1;  // unknowns; and z
  const Ring<F>* ring;
  Heat* heat;
  T start[Z], f[B], P, u[B], w[B], matrix[B][B], square, known[TERMS];
  Block(const Ring<F>* its, Heat* own) : ring(its), heat(own) {}

  // The matrix of light and carriers at the start; false where heat grows too fast for the step.
  INLINE bool linearize(const T* y, const T* x, const T& rise, const Dual<1>* detuning, double s) {
    using J = Dual<Z, T>;
    for (int m = 0; m < B; m++) start[m] = y[m];
    start[B] = heat->temperature(x), square = y[2 * F] * y[2 * F] + EPS * EPS;
    for (int k = 0; k < ring->terms; k++)
      if (ring->term[k].p != 1) known[k] = power(square, ring->term[k].exponent());
    J at[Z], slopes[B], added = zero<J>();
    added.v = rise;
    for (int m = 0; m < Z; m++) at[m] = seeded<Z, T>(start[m], m);
    const J warm = optics<F, J>(*ring, at, at[B], added, detuning, slopes, [&](int k, const J& x) {
      J r;
      const T by = ring->term[k].exponent() * known[k] / x.v;
      r.v = known[k];
      for (int i = 0; i < Z; i++) r.d[i] = by * x.d[i];
      return r;
    });
    P = warm.v;
    if (!heat->start(x, s, P)) return false;
    for (int m = 0; m < B; m++) f[m] = slopes[m].v, u[m] = slopes[m].d[B], w[m] = warm.d[m];
    for (int m = 0; m < B; m++)
      for (int l = 0; l < B; l++) matrix[m][l] = (m == l ? s : 0.0) - slopes[m].d[l] - heat->G * (u[m] * w[l]);
    return true;
  }
  // The right-hand side of a stage: o = start + sum_j a_j k_j, of light, carriers and z; r, of light and carriers, and
  // the z that heat gives without what comes back. light[0] is that of the start.
  INLINE void right_hand_side(const Stage& stage, const T* k, int row, const Light* light, int i,
                              const T& rise, T* o, T* r) const {
    const int q = stage.number;
    const Dual<1> *in = light[q].in + 2 * F * i, *rising = light[0].in + 2 * F * i;
    const Dual<1> *detuning = light[q].detuning + F * i, *turn = light[0].detuning + F * i;
    T slopes[B], heating = P;
    for (int m = 0; m < Z; m++) o[m] = start[m], r[m] = zero<T>();
    for (int j = 0; j < q; j++)
      for (int m = 0; m < Z; m++) o[m] += stage.a[j] * k[j * row + m], r[m] += stage.c[j] * k[j * row + m];
    if (q == 0) memcpy(slopes, f, sizeof f);
    else
      heating = optics<F, T>(*ring, o, o[B], rise, detuning, slopes, [&](int k, const T& x) {
        return near_power(x, ring->term[k].exponent(), square, known[k]);
      });
    r[B] = heat->stage(stage, heating);
    for (int m = 0; m < B; m++) r[m] += slopes[m] + u[m] * r[B];
    for (int m = 0; m < 2 * F; m++) {  // i s: -Im s in Re a, Re s in Im a
      const int other = m ^ 1;
      const T came = in[other].v + stage.slope * rising[other].d[0] - (stage.slope * turn[m / 2].d[0]) * start[other];
      r[m] += m % 2 ? came : -came;
    }
  }
  INLINE void solve(const T* r, T* k) const {  // k of light and carriers; matrix: the inverse
    for (int m = 0; m < B; m++) {
      k[m] = zero<T>();
      for (int l = 0; l < B; l++) k[m] += matrix[m][l] * r[l];
    }
  }
  INLINE void back_substitute(int q, T* k) const {  // of heat and z, where k of light and carriers is known
    T feedback = zero<T>();
    for (int m = 0; m < B; m++) feedback += w[m] * k[m];
    heat->add_feedback(q, feedback);
    k[B] += feedback * heat->G;
  }
  // The end of the step, from o and k of the last stage.
  INLINE void finish(const Stage& last, const T* o, const T* k, T* y, T* x, T* z_start, T* z_end) const {
    for (int m = 0; m < B; m++) y[m] = o[m] + k[m];
    *z_start = start[B], *z_end = o[B] + k[B];
    heat->finish(last, x);
  }
};

struct Past { double* steps; int64_t filled, room; };  // of a circuit with delays: its last steps
// One ring. S is the number of stages where it is known when this is compiled, and 0 elsewhere.
template <int fields, int S, class T, class Heat> struct Single {
  static constexpr int F = fields, B = 2 * F + 1, Z = B + 1;
  const Problem& p;
  const Ring<F> ring;
  T *k, *kx, z_start[1], z_end[1];  // stages x Z, of light, carriers and z; stages x order, of heat
  Heat heat;

  Single(const Problem& problem, Past&, Arena& arena)
      : p(problem), ring(ring_of<F>(p, 0)), k(arena.take<T>(STAGES * Z)),
        kx(arena.take<T>(STAGES * p.order)), heat(p, 0, kx, arena) {}

  void begin(const T* y, bool, double) { z_start[0] = z_end[0] = heat.temperature(y + B); }
  double heat_error(int, double) const { return heat.error(); }
  // What only a circuit has: heat of neighbours, waves between the rings, delays.
  double other(double, int) const { return 0; }
  int width() const { return 0; }
  void observe(int, double, double, double, const double*, double*) const {}
  template <class At> void note(int, double, double, const At&) {}
  void accept(double, double, double, double) {}
  double resolved(double, double h) const { return h; }

  // A step of h ns from y to out; light: at the stages. False where there is no answer.
  bool step(const T* __restrict y, double, double h, const Light* __restrict light, T* __restrict out) {
    const T none = zero<T>();
    const int count = S ? S : p.method.stages;
    Block<F, T, Heat> block(&ring, &heat);
    if (!block.linearize(y, y + B, none, light[0].detuning, 1 / (p.method.gamma * h))) return false;
    invert(block.matrix);
    T stages[STAGES * Z], o[Z], r[Z];
    auto stage = [&](int q) INLINE_LAMBDA {
      T* now = stages + q * Z;
      block.right_hand_side(Stage(p.method, count, q, h), stages, Z, light, 0, none, o, r);
      block.solve(r, now);
      now[B] = r[B], block.back_substitute(q, now);
    };
    if constexpr (S > 0) {
#pragma GCC unroll 8
      for (int q = 0; q < S; q++) stage(q);
    } else {
      for (int q = 0; q < count; q++) stage(q);
    }
    const Stage last(p.method, count, count - 1, h);
    block.finish(last, o, stages + (count - 1) * Z, out, out + B, z_start, z_end);
    for (int m = 0; m < count * Z; m++) k[m] = stages[m];
    return true;
  }
};
