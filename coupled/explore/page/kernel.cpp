// The kernel as the page calls it: one ring, one field, poles of heat, constant light.
#include "../../kernel/loop.hpp"
#include "../../kernel/slopes.hpp"

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
  double in[] = {sqrt(p->power.c[0]), 0};
  slopes<1>(*p, {in, (double*)p->detuning.c, nullptr, nullptr}, y, dy, J);
}
