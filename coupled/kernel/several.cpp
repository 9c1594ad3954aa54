// One ring with fields of several resonances: a file of its own, so that two compilers run at once.
#include "kernel.hpp"

int64_t integrate_several(const Problem& p, Loop& L, double* y, double* rows, int64_t capacity,
                          const double* times, int64_t wanted, double* steps, char* memory) {
  auto call = p.fields == 2 ? integrate<2> : p.fields == 3 ? integrate<3> : integrate<4>;
  return call(p, L, y, rows, capacity, times, wanted, steps, memory);
}
