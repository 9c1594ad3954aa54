// The derivative of the flow, and of the equations.
#include "kernel.hpp"

constexpr int COLUMNS = 7;  // directions at once; and the value: a line of the cache

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

// f = dy/dt under this light.
template <int F, class T>
static void rates(const Problem& p, const Light& light, const T* y, T* f) {
  constexpr int B = 2 * F + 1;
  const int R = p.rings, K = p.order;
  for (int i = 0; i < R; i++) {
    const Ring<F> ring = ring_of<F>(p, i);
    const T *x = y + R * B + i * K;
    T *own = f + i * B, *heat = f + R * B + i * K, z = zero<T>(), rise = zero<T>();
    for (int k = 0; k < K; k++)
      z += x[k] * (p.heat == QUADRATIC ? p.C[k] : p.read ? p.read[i * K + k] : 1.0);
    for (int k = 0; k < R * K && p.cross; k++) rise += p.cross[i * R * K + k] * y[R * B + k];
    const T P = optics<F>(ring, y + i * B, z, rise, light.detuning + i * F, own,
                          [&](int k, const T& s) { return power(s, ring.e[k]); });
    for (int k = 0; k < F; k++) {  // light that comes in
      const double* in = light.in + 2 * (i * F + k);
      own[2 * k] = own[2 * k] - in[1], own[2 * k + 1] = own[2 * k + 1] + in[0];
    }
    for (int k = 0; k < K; k++)
      heat[k] = p.heat == QUADRATIC ? quadratic(p, k, x, P)
                                    : p.gain[i * K + k] * P - p.rate[i * K + k] * x[k];
  }
  for (int m = 0; m < R && p.light != SINGLE; m++)
    for (int l = 0; l < R; l++) {  // light of other rings: M_ij a_j
      const int i = p.sequence[m], j = p.sequence[l];
      double M[2] = {0, 0};
      if (p.taken && l < m) add_product(M, p.taken + 2 * i, p.sent + 2 * j);
      add_product(f + i * B, p.between && i != j ? p.between + 2 * (i * R + j) : M, y + j * B);
    }
}

// dy/dt and its derivative J (size x size) in a piece of the drive at the time t.
template <int F>
static void slopes(const Problem& p, const double* y, int piece, double t, double* dy, double* J,
                   Arena& arena) {
  using T = Dual<COLUMNS>;
  const int size = p.rings * (2 * F + 1 + p.order);
  const Light light = light_of(arena, p.rings * F);
  T *at = arena.take<T>(size), *f = arena.take<T>(size);
  if (!arena.base) return;
  light_at(p, places_of(p, piece), t, light);
  for (int first = 0; first < size; first += COLUMNS) {
    for (int i = 0; i < size; i++) {
      at[i] = zero<T>() + y[i];
      if (i >= first && i < first + COLUMNS) at[i].d[i - first] = 1;
    }
    rates<F>(p, light, at, f);
    for (int i = 0; i < size; i++) {
      dy[i] = f[i].v;
      for (int c = 0; c < COLUMNS && first + c < size; c++) J[i * size + first + c] = f[i].d[c];
    }
  }
}

EXPORT int64_t ring_slopes(const Problem* p, const double* y, int piece, double t, double* dy,
                           double* J, char* memory) {
  Arena arena = {memory};
  const int F = p->fields;
  auto call = F == 1 ? slopes<1> : F == 2 ? slopes<2> : F == 3 ? slopes<3> : slopes<4>;
  call(*p, y, piece, t, dy, J, arena);
  return (int64_t)arena.used;
}
