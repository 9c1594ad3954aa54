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

// S is the number of stages where it is known when this is compiled, and 0 elsewhere.
constexpr int STAGES = 8;  // at most
template <int S> inline int stages_of(const Problem& p) { return S ? S : p.method.stages; }

struct Arena {  // hands out the caller's memory; without any it counts what is needed
  char* base;
  size_t used = 0;
  template <class X> X* take(size_t n) {
    X* x = base ? (X*)(base + used) : nullptr;
    used += (n * sizeof(X) + 63) / 64 * 64;
    return x;
  }
};

inline Light light_of(Arena& arena, int n) {  // of n fields
  double *in = arena.take<double>(4 * n), *detuning = arena.take<double>(2 * n);
  return {in, detuning, in + 2 * n, detuning + n};
}

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

// ---- small linear algebra ---------------------------------------------------------------------

template <class T> inline void invert(T (&m)[3][3]) {  // by cofactors; s keeps it well conditioned
  const T c0 = m[1][1] * m[2][2] - m[1][2] * m[2][1], c1 = m[1][2] * m[2][0] - m[1][0] * m[2][2];
  const T c2 = m[1][0] * m[2][1] - m[1][1] * m[2][0];
  const T d = 1.0 / (m[0][0] * c0 + m[0][1] * c1 + m[0][2] * c2);
  const T r[3][3] = {
      {d * c0, d * (m[0][2] * m[2][1] - m[0][1] * m[2][2]),
       d * (m[0][1] * m[1][2] - m[0][2] * m[1][1])},
      {d * c1, d * (m[0][0] * m[2][2] - m[0][2] * m[2][0]),
       d * (m[0][2] * m[1][0] - m[0][0] * m[1][2])},
      {d * c2, d * (m[0][1] * m[2][0] - m[0][0] * m[2][1]),
       d * (m[0][0] * m[1][1] - m[0][1] * m[1][0])}};
  memcpy(m, r, sizeof r);
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
      for (int k = 0; k < n; k++) {
        T x = A[j * n + k]; A[j * n + k] = A[pivot * n + k]; A[pivot * n + k] = x;
      }
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
template <int B, class T> inline void invert(T (&m)[B][B]) {
  T factors[B * B], column[B];
  int order[B];
  memcpy(factors, m, sizeof m), factorize(factors, order, B);
  for (int j = 0; j < B; j++) {
    for (int i = 0; i < B; i++) column[i] = zero<T>() + (i == j);
    substitute(factors, order, B, column);
    for (int i = 0; i < B; i++) m[i][j] = column[i];
  }
}

// ---- heat of one ring in a step ----------------------------------------------------------------

// Poles. READ: z = sum read_k x_k rather than sum x_k.
template <int S, class T, bool READ = false> struct Poles {
  int n, row, stages;  // states; how far the stages are apart in k; their number
  const double *gain, *rate, *read;
  double *damp, G;
  T* k;
  const T* x0;

  Poles(const Problem& p, int ring, T* kx, Arena& arena) {
    n = p.order, row = p.rings * n, k = kx + ring * n, damp = arena.take<double>(n);
    stages = stages_of<S>(p);
    gain = p.gain + ring * n, rate = p.rate + ring * n;
    read = READ ? p.read + ring * n : nullptr;
  }
  T weigh(int i, const T& x) const { return READ ? read[i] * x : x; }
  T temperature(const T* x) const {
    T z = zero<T>();
    for (int i = 0; i < n; i++) z += weigh(i, x[i]);
    return z;
  }
  bool start(const T* x, double s, const T&) {  // false: heat grows faster than a step follows
    double total = 0;
    for (int i = 0; i < n; i++) {
      damp[i] = 1 / (s + rate[i]);
      total += READ ? read[i] * (gain[i] * damp[i]) : gain[i] * damp[i];
    }
    x0 = x, G = total;
    return true;
  }
  // The stage q under the power P: its z, without what comes back from light and carriers.
  INLINE T stage(int q, const double* a, const double* c, const T& P) const {
    const double *__restrict g = gain, *__restrict r = rate, *__restrict d = damp;
    const T *__restrict before = k, *__restrict start = x0;
    T* __restrict now = k + q * row;
    T back = zero<T>();
    for (int i = 0; i < n; i++) {
      T x = start[i], sum = zero<T>();
      for (int j = 0; j < q; j++)
        x += a[j] * before[j * row + i], sum += c[j] * before[j * row + i];
      now[i] = x = (sum - r[i] * x + g[i] * P) * d[i];
      back += weigh(i, x);
    }
    return back;
  }
  INLINE void feed(int q, const T& power) const {
    const double *__restrict g = gain, *__restrict d = damp;
    T* __restrict now = k + q * row;
    for (int i = 0; i < n; i++) now[i] += (g[i] * d[i]) * power;
  }
  void finish(const double* a, T* __restrict out) const {
    const T *__restrict all = k, *__restrict start = x0;
    const int last = (S ? S : stages) - 1;
    for (int i = 0; i < n; i++) {
      T x = start[i] + all[last * row + i];
      for (int j = 0; j < last; j++) x += a[j] * all[j * row + i];
      out[i] = x;
    }
  }
  double error() const {
    double e = 0;
    for (int i = 0; i < n; i++) e += magnitude(weigh(i, k[(stages - 1) * row + i]));
    return e;
  }
};

// dx/dt = A x + H[x, x] + (G x + B) P:  k_x = M^-1 (r_x + b w.k_o),  M = s - A - 2 H[x, .] - G P,
// b = G x + B. An L-stable step damps a mode that grows faster than s, and its error does not show
// it; without such a mode det M > 0.
template <class T> struct Quadratic {
  int n, last;
  const Problem& p;
  T *k, *M, *b, *x, G;
  const T* x0;
  int* order;

  Quadratic(const Problem& problem, int, T* kx, Arena& arena) : p(problem) {
    n = p.order, last = p.method.stages - 1, k = kx, M = arena.take<T>(n * n), b = arena.take<T>(n);
    x = arena.take<T>(n), order = arena.take<int>(n);
  }
  T temperature(const T* state) const {
    T z = zero<T>();
    for (int i = 0; i < n; i++) z += p.C[i] * state[i];
    return z;
  }
  bool start(const T* state, double s, const T& P) {
    x0 = state;
    for (int i = 0; i < n; i++) {
      b[i] = zero<T>() + p.B[i];
      for (int j = 0; j < n; j++) {
        T m = P * -p.G[i * n + j] - p.A[i * n + j];
        const double* H = p.H + (i * n + j) * n;
        for (int l = 0; l < n; l++) m -= (2 * H[l]) * state[l];
        M[i * n + j] = i == j ? m + s : m, b[i] += p.G[i * n + j] * state[j];
      }
    }
    const bool follows = factorize(M, order, n);
    substitute(M, order, n, b);
    G = temperature(b);
    return follows;
  }
  T stage(int q, const double* a, const double* c, const T& P) const {
    T* now = k + q * n;
    for (int i = 0; i < n; i++) {
      x[i] = x0[i], now[i] = zero<T>();
      for (int j = 0; j < q; j++) x[i] += a[j] * k[j * n + i], now[i] += c[j] * k[j * n + i];
    }
    for (int i = 0; i < n; i++) now[i] += quadratic(p, i, x, P);
    substitute(M, order, n, now);
    return temperature(now);
  }
  void feed(int q, const T& power) const {
    for (int i = 0; i < n; i++) k[q * n + i] += b[i] * power;
  }
  void finish(const double*, T* out) const {
    for (int i = 0; i < n; i++) out[i] = x[i] + k[last * n + i];
  }
  double error() const {
    double e = 0;
    for (int i = 0; i < n; i++) e += p.weight[i] * magnitude(k[last * n + i]);
    return e;
  }
};

// ---- light and carriers of one ring in a step --------------------------------------------------

template <int F, class T> struct Block {  // linearized at the start of the step
  static constexpr int B = 2 * F + 1, Z = B + 1;  // unknowns; and z
  T start[Z], f[B], P, u[B], w[B], matrix[B][B], square, known[TERMS];

  void linearize(const Ring<F>& ring, const T* y, const T& z, const T& rise,
                 const double* detuning) {
    using J = Dual<Z, T>;
    for (int m = 0; m < B; m++) start[m] = y[m];
    start[B] = z, square = y[2 * F] * y[2 * F] + EPS * EPS;
    for (int k = 0; k < ring.terms; k++)
      if (ring.e[k] != 0) known[k] = power(square, ring.e[k]);
    J at[B], slopes[B], added = zero<J>();
    added.v = rise;
    for (int m = 0; m < B; m++) at[m] = seeded<Z, T>(start[m], m);
    const J heat = optics<F, J>(ring, at, seeded<Z, T>(z, B), added, detuning, slopes,
                                [&](int k, const J& x) {
      J r;
      const T by = ring.e[k] * known[k] / x.v;
      r.v = known[k];
      for (int i = 0; i < Z; i++) r.d[i] = by * x.d[i];
      return r;
    });
    for (int m = 0; m < B; m++) {
      f[m] = slopes[m].v, u[m] = slopes[m].d[B], w[m] = heat.d[m];
      for (int l = 0; l < B; l++) matrix[m][l] = -slopes[m].d[l];
    }
    P = heat.v;
  }
  template <class Gain> void eliminate_heat(double s, const Gain& G) {
    for (int m = 0; m < B; m++)
      for (int l = 0; l < B; l++) matrix[m][l] += (m == l ? s : 0.0) - G * (u[m] * w[l]);
  }
  // f and P at a stage; the first one is the start.
  T stage(int q, const Ring<F>& ring, const T* o, const T& rise, const double* detuning,
          T* slopes) const {
    if (q == 0) {
      for (int m = 0; m < B; m++) slopes[m] = f[m];
      return P;
    }
    return optics<F, T>(ring, o, o[B], rise, detuning, slopes, [&](int k, const T& x) {
      return near_power(x, ring.e[k], square, known[k]);
    });
  }
  // Adds what comes in and how it changes in a stage; light[0] is that of the start.
  static void shine(const Light& now, const Light& first, int ring, double g, const T* y, T* r) {
    const double *in = now.in + 2 * F * ring, *rising = first.in_slope + 2 * F * ring;
    const double* turn = first.detuning_slope + F * ring;
    for (int f = 0; f < F; f++) {
      const T &re = y[2 * f], &im = y[2 * f + 1];
      r[2 * f] += (g * turn[f]) * im - (in[2 * f + 1] + g * rising[2 * f + 1]);
      r[2 * f + 1] += (in[2 * f] + g * rising[2 * f]) - (g * turn[f]) * re;
    }
  }
};
// o = start + sum_j a_j k_j and r = sum_j c_j k_j over the stages before q.
template <int Z, class T>
INLINE void combine(int q, const double* a, const double* c, const T* k, int row, const T* start,
                    T* o, T* r) {
  for (int m = 0; m < Z; m++) o[m] = start[m], r[m] = zero<T>();
  for (int j = 0; j < q; j++)
    for (int m = 0; m < Z; m++) o[m] += a[j] * k[j * row + m], r[m] += c[j] * k[j * row + m];
}

struct Past { double* steps; int64_t filled, room; };  // of a circuit with delays: its last steps

// ---- one ring ----------------------------------------------------------------------------------

template <int F, int S, class T, class Heat> struct Single {
  static constexpr int B = 2 * F + 1, Z = B + 1;
  const Problem& p;
  const Ring<F> ring;
  T *k, *kx, z_start[1], z_end[1];  // stages x Z, of light, carriers and z; stages x order, of heat
  Heat heat;

  Single(const Problem& problem, Past&, Arena& arena)
      : p(problem), ring(ring_of<F>(p, 0)), k(arena.take<T>(STAGES * Z)),
        kx(arena.take<T>(STAGES * p.order)), heat(p, 0, kx, arena) {}

  void begin(const T* y, bool, double) { z_start[0] = z_end[0] = heat.temperature(y + B); }
  double heat_error(int) const { return heat.error(); }
  // What only a circuit has: heat of neighbours, waves between the rings, delays.
  double missed(int) const { return 0; }
  double other(int) const { return 0; }
  double other_at(double, int) const { return 0; }
  int width() const { return 0; }
  void waves(const Places&, double, double, const double*, double*) const {}
  void observe(const Places&, double, double, double, const double*, double*) const {}
  template <class At> void note(const Places&, double, double, const At&) {}
  void accept(double, double, double, double) {}
  double resolved(double, double h) const { return h; }

  // A step of h ns from y to out; light: at the stages. False where there is no answer.
  bool step(const T* __restrict y, double, double h, const Light* __restrict light,
            T* __restrict out) {
    const double s = 1 / (p.method.gamma * h), per_h = 1 / h;
    Block<F, T> block;
    const T none = zero<T>();
    block.linearize(ring, y, heat.temperature(y + B), none, light[0].detuning);
    if (!heat.start(y + B, s, block.P)) return false;
    block.eliminate_heat(s, heat.G);
    invert(block.matrix);
    const int count = stages_of<S>(p);
    T stages[STAGES * Z], o[Z], r[Z], f[B];
    auto stage = [&](int q) INLINE_LAMBDA {
      double a[STAGES], c[STAGES];
      for (int j = 0; j < q; j++)
        a[j] = p.method.a[q * count + j], c[j] = p.method.c[q * count + j] * per_h;
      combine<Z>(q, a, c, stages, Z, block.start, o, r);
      const T P = block.stage(q, ring, o, none, light[q].detuning, f);
      const T back = heat.stage(q, a, c, P);
      for (int m = 0; m < B; m++) r[m] += f[m] + block.u[m] * back;
      block.shine(light[q], light[0], 0, p.method.slope[q] * h, block.start, r);
      T feedback = zero<T>(), *now = stages + q * Z;
      for (int m = 0; m < B; m++) {
        now[m] = zero<T>();
        for (int l = 0; l < B; l++) now[m] += block.matrix[m][l] * r[l];
        feedback += block.w[m] * now[m];
      }
      heat.feed(q, feedback);
      now[B] = back + feedback * heat.G;
    };
    if constexpr (S > 0) {
#pragma GCC unroll 8
      for (int q = 0; q < S; q++) stage(q);
    } else {
      for (int q = 0; q < count; q++) stage(q);
    }
    const T* last = stages + (count - 1) * Z;
    for (int m = 0; m < B; m++) out[m] = o[m] + last[m];
    z_start[0] = block.start[B], z_end[0] = o[B] + last[B];
    heat.finish(p.method.a + (count - 1) * count, out + B);
    for (int m = 0; m < count * Z; m++) k[m] = stages[m];
    return true;
  }
};
