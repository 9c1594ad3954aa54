// Derivatives by dual numbers: of the equations, and of the flow.
#pragma once
#include "step.hpp"
constexpr int COLUMNS = 7;  // directions at once; and the value: a line of the cache

// dy/dt of rings under their light.
template <int F, class T> void slopes(const Problem& p, const Light& light, const T* y, T* dy) {
  constexpr int B = 2 * F + 1;
  const int R = p.rings, K = p.order;
  const T* heat = y + R * B;
  for (int i = 0; i < R; i++) {
    const Ring<F> ring = ring_of<F>(p, i);
    const T* x = heat + i * K;
    T *f = dy + i * B, *flow = dy + R * B + i * K, z = zero<T>(), rise = zero<T>();
    for (int k = 0; k < K; k++) z += p.read[i * K + k] * x[k];
    for (int k = 0; k < R * K && p.cross; k++) rise += p.cross[i * R * K + k] * heat[k];
    const T P = optics<F, T>(ring, y + i * B, z, rise, light.detuning + i * F, f,
                             [&](int k, const T& N) { return power(N, ring.term[k].exponent()); });
    for (int m = 0; m < 2 * F; m++)  // i s: -Im s in Re a, Re s in Im a
      f[m] = f[m] + (m % 2 ? 1 : -1) * light.in[2 * F * i + (m ^ 1)].v;
    for (int k = 0; k < K; k++)
      if (p.heat == QUADRATIC) {
        flow[k] = p.B[k] * P;
        for (int j = 0; j < K; j++) flow[k] += quadratic(p, k, j, 1, x, P) * x[j];
      } else {
        flow[k] = p.gain[i * K + k] * P - p.rate[i * K + k] * x[k];
      }
  }
  for (int k = 0; k < R * R && p.between; k++)  // light of other rings
    add_product(dy + k / R * B, p.between + 2 * k, y + k % R * B);
}

// dy/dt in a piece of the drive at the time t; the columns of V become their products with its derivative.
template <int F, class T>
void slopes_at(const Problem& p, const double* y0, int piece, double t, double* dy, double* V, int columns,
               Arena& arena) {
  const int size = p.rings * (2 * F + 1 + p.order);
  const Light light = light_of(arena, p.rings * F);
  T *y = arena.take<T>(size), *rate = arena.take<T>(size);
  if (!arena.base) return;
  light_at(p, piece, t, light);
  differentiate(size, y0, dy, V, columns, y, [&](const T* at) {
    slopes<F, T>(p, light, at, rate);
    return rate;
  });
}

// The same steps again, under constant light; the columns of V become their products with the derivative of the flow.
template <class T, class System>
void follow(const Problem& p, const double* y0, const double* steps, int64_t count, double* y_end, double* V,
            int columns, Arena& arena) {
  const int n = p.rings * System::F, size = n * 2 + p.rings * (1 + p.order);
  Past past = {};
  System system(p, past, arena);
  T *first = arena.take<T>(size), *second = arena.take<T>(size);
  Light light[STAGES];
  light[0] = light_of(arena, n);
  if (!arena.base) return;
  light_at(p, 0, p.edges[0], light[0]);
  for (int q = 1; q < p.method.stages; q++) light[q] = light[0];
  differentiate(size, y0, y_end, V, columns, first, [&](T* y) {
    double t = p.edges[0];
    system.begin(y, true, t);
    T* out = second;
    for (int64_t k = 0; k < count; t += steps[k++]) {
      system.step(y, t, steps[k], light, out);
      system.accept(t, steps[k], steps[k], t + steps[k]);
      T* x = y; y = out; out = x;
    }
    return y;
  });
}
