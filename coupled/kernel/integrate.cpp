#include "kernel.hpp"

int64_t integrate_several(const Problem& p, Loop& L, double* y, double* rows, int64_t capacity,
                          const double* times, int64_t wanted, double* steps, char* memory);

// Integrates on from y; returns why it came back. With memory = null: the bytes of memory it needs.
EXPORT int64_t ring_integrate(const Problem* p, Loop* L, double* y, double* rows,
                              int64_t capacity, const double* times, int64_t wanted,
                              double* steps, char* memory) {
  if (p->fields > 1)
    return integrate_several(*p, *L, y, rows, capacity, times, wanted, steps, memory);
  return integrate<1>(*p, *L, y, rows, capacity, times, wanted, steps, memory);
}
