// The kernel as the page calls it: one ring, one field, poles of heat, constant light.
#include "../../kernel/cpp/slopes.hpp"
#include "../../kernel/cpp/layout.cpp"

template <int S, class T> using One = Single<1, S, T, Poles<T>>;
using Number = Dual<COLUMNS>;
alignas(64) static char memory[1 << 20];  // enough for 60 poles, the most that a page has

EXPORT int page_integrate(const Problem* p, Loop* L, double* y, double* rows, int capacity,
                          const double* times, int wanted, double* steps) {
  Arena arena = {memory};
  return p->method.stages == 6
    ? Integration<One<6, double>>(*p, *L, y, rows, arena).run(capacity, times, wanted, steps)
    : Integration<One<8, double>>(*p, *L, y, rows, arena).run(capacity, times, wanted, steps);
}

// The same steps again: V, size x size, is replaced by its product with the derivative of the flow.
EXPORT void page_follow(const Problem* p, const double* y0, const double* steps, int count,
                        double* y_end, double* V) {
  Arena arena = {memory};
  follow<Number, One<0, Number>>(*p, y0, steps, count, y_end, V, 3 + p->order, arena);
}

// dy/dt; V, size x size, is replaced by its product with the derivative.
EXPORT void page_slopes(const Problem* p, const double* y, double* dy, double* V) {
  Arena arena = {memory};
  slopes_at<1, Number>(*p, y, 0, 0, dy, V, 3 + p->order, arena);
}
