// The kernel as the page calls it: one ring, one field, poles of heat, constant light.
#include "../../kernel/loop.hpp"

#define EXPORT extern "C" __attribute__((visibility("default")))

template <int S, class T> using One = Single<1, S, T, Poles<S, T>>;
alignas(64) static char memory[1 << 20];  // enough for 60 poles, the most that a page has

EXPORT int ring_integrate(const Problem* p, Loop* L, double* y, double* rows, int capacity,
                          const double* times, int wanted, double* steps) {
  Arena arena = {memory};
  return p->method.stages == 6
    ? Integration<1, One<6, double>>(*p, *L, y, rows, arena).run(capacity, times, wanted, steps)
    : Integration<1, One<8, double>>(*p, *L, y, rows, arena).run(capacity, times, wanted, steps);
}

// The same steps again: V, size x size, is replaced by its product with the derivative of the flow.
EXPORT void ring_follow(const Problem* p, const double* y0, const double* steps, int count,
                        double* y_end, double* V) {
  Arena arena = {memory};
  follow<1, 8, Dual<8>, One<0, Dual<8>>>(*p, y0, steps, count, y_end, V, 3 + p->order, arena);
}

// dy/dt and its derivative, size x size.
EXPORT void ring_slopes(const Problem* p, const double* y, double* dy, double* J) {
  const Ring<1> ring = ring_of<1>(*p, 0);
  const int size = 3 + p->order;
  double z = 0;
  for (int k = 3; k < size; k++) z += y[k];
  Dual<4> at[3], f[3];
  for (int m = 0; m < 3; m++) at[m] = seeded<4, double>(y[m], m);
  auto factor = [&](int k, const Dual<4>& s) { return power(s, ring.e[k]); };
  const Dual<4> P = optics<1>(ring, at, seeded<4, double>(z, 3), zero<Dual<4>>(), p->detuning.c, f,
                              factor);
  f[1].v += sqrt(p->power.c[0]);
  for (int m = 0; m < size; m++) {
    const double gain = m < 3 ? 0 : p->gain[m - 3], rate = m < 3 ? 0 : p->rate[m - 3];
    dy[m] = m < 3 ? f[m].v : gain * P.v - rate * y[m];
    for (int l = 0; l < size; l++)
      J[m * size + l] = m < 3 ? f[m].d[l < 3 ? l : 3] : l < 3 ? gain * P.d[l] : l == m ? -rate : 0;
  }
}
