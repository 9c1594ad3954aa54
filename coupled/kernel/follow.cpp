// The derivative of the flow, and of the equations.
#include "kernel.hpp"

constexpr int COLUMNS = 8;  // directions that are followed at once, where there are many

// The `count` steps of these lengths again, from y0 to y_end; V, size x columns, is replaced by its
// product with the derivative of the flow. Returns the bytes of memory it needs.
EXPORT int64_t ring_follow(const Problem* p, const double* y0, const double* steps, int64_t count,
                           double* y_end, double* V, int columns, char* memory) {
  auto with = [&](auto number, auto directions) {
    using T = decltype(number);
    return with_system<1, T, false>(*p, [&](auto type) -> int64_t {
      Arena arena = {memory};
      follow<1, decltype(directions)::value, T, typename decltype(type)::System>(
          *p, y0, steps, count, y_end, V, columns, arena);
      return (int64_t)arena.used;
    });
  };
  if (memory && !columns) return with(0.0, Number<0>());
  if (memory && columns <= 2) return with(Dual<2>(), Number<2>());
  return with(Dual<COLUMNS>(), Number<COLUMNS>());
}

// dy/dt and its derivative (size x size) in a piece of the drive at the time t.
template <int F>
static void slopes(const Problem& p, const double* y, int piece, double t, double* dy, double* J,
                   Arena& arena) {
  constexpr int B = 2 * F + 1, Z = B + 1;
  const int R = p.rings, K = p.order, size = R * (B + K);
  const Light light = {arena.take<double>(2 * R * F), arena.take<double>(R * F),
                       arena.take<double>(2 * R * F), arena.take<double>(R * F)};
  if (!arena.base) return;
  light_at(p, places_of(p, piece), t, light);
  memset(J, 0, size * size * sizeof(double));
  auto weight = [&](int i, int j, int k) {  // of the state k of ring j in the temperature of i
    if (i != j) return p.cross ? p.cross[(i * R + j) * K + k] : 0.0;
    return p.heat == QUADRATIC ? p.C[k] : p.read ? p.read[i * K + k] : 1.0;
  };
  for (int i = 0; i < R; i++) {
    const Ring<F> ring = ring_of<F>(p, i);
    const double *own = y + i * B, *x = y + R * B + i * K;
    double z = 0;
    Dual<Z> other = zero<Dual<Z>>();
    for (int k = 0; k < K; k++) z += weight(i, i, k) * x[k];
    for (int j = 0; j < R; j++)
      for (int k = 0; k < K && j != i; k++) other.v += weight(i, j, k) * y[R * B + j * K + k];
    Dual<Z> at[B], f[B];
    for (int m = 0; m < B; m++) at[m] = seeded<Z, double>(own[m], m);
    auto factor = [&](int k, const Dual<Z>& s) { return power(s, ring.e[k]); };
    const Dual<Z> P = optics<F>(ring, at, seeded<Z, double>(z, B), other, light.detuning + i * F,
                                f, factor);
    for (int m = 0; m < B; m++) {
      double* row = J + (i * B + m) * size;
      dy[i * B + m] = f[m].v;
      for (int l = 0; l < B; l++) row[i * B + l] += f[m].d[l];
      for (int j = 0; j < R; j++)
        for (int k = 0; k < K; k++)
          row[R * B + j * K + k] += weight(i, j, k) * f[m].d[B] / (j == i ? 1 : 1 + 2 * ring.bend * z);
    }
    for (int f = 0; f < F; f++) {  // light that comes in
      dy[i * B + 2 * f] -= light.in[2 * (i * F + f) + 1];
      dy[i * B + 2 * f + 1] += light.in[2 * (i * F + f)];
    }
    for (int k = 0; k < K; k++) {
      double *row = J + (R * B + i * K + k) * size, gain, sum;
      if (p.heat == QUADRATIC) {
        gain = p.B[k], sum = 0;
        for (int l = 0; l < K; l++) {
          const double *H = p.H + (k * K + l) * K, A = p.A[k * K + l] + p.G[k * K + l] * P.v;
          double Hx = 0;
          for (int m = 0; m < K; m++) Hx += H[m] * x[m];
          gain += p.G[k * K + l] * x[l], sum += (A + Hx) * x[l];
          row[R * B + i * K + l] += A + 2 * Hx;
        }
        sum += p.B[k] * P.v;
      } else {
        gain = p.gain[i * K + k], sum = gain * P.v - p.rate[i * K + k] * x[k];
        row[R * B + i * K + k] -= p.rate[i * K + k];
      }
      dy[R * B + i * K + k] = sum;
      for (int l = 0; l < B; l++) row[i * B + l] += gain * P.d[l];
    }
  }
  if (p.light == SINGLE) return;
  auto couple = [&](int i, int j, double re, double im) {  // M_ij
    double *a = J + i * B * size + j * B, *d = dy + i * B;
    const double* e = y + j * B;
    a[0] += re, a[1] -= im, a[size] += im, a[size + 1] += re;
    d[0] += re * e[0] - im * e[1], d[1] += re * e[1] + im * e[0];
  };
  for (int m = 0; m < R; m++)
    for (int l = 0; l < R; l++) {
      const int i = p.sequence[m], j = p.sequence[l];
      double M[2] = {0, 0};
      if (p.taken && l < m) add_product(M, p.taken + 2 * i, p.sent + 2 * j);
      if (p.between && i != j) M[0] = p.between[2 * (i * R + j)], M[1] = p.between[2 * (i * R + j) + 1];
      couple(i, j, M[0], M[1]);
    }
}

EXPORT int64_t ring_slopes(const Problem* p, const double* y, int piece, double t, double* dy,
                           double* J, char* memory) {
  Arena arena = {memory};
  switch (p->fields) {
    case 1: slopes<1>(*p, y, piece, t, dy, J, arena); break;
    case 2: slopes<2>(*p, y, piece, t, dy, J, arena); break;
    case 3: slopes<3>(*p, y, piece, t, dy, J, arena); break;
    default: slopes<4>(*p, y, piece, t, dy, J, arena);
  }
  return (int64_t)arena.used;
}
