// The integration that Python calls: one ring with up to four fields, or a circuit.
#include "kernel.hpp"

template <int F>
static int64_t integrate(const Problem& p, Loop& L, double* y, double* rows, int64_t capacity,
                         const double* times, int64_t wanted, double* steps, char* memory) {
  return with_system<F, double, F == 1>(p, [&](auto type) -> int64_t {
    Arena arena = {memory};
    Integration<F, typename decltype(type)::System> integration(p, L, y, rows, arena);
    return memory ? integration.run(capacity, times, wanted, steps) : (int64_t)arena.used;
  });
}

// Integrates on from y; returns why it came back. With memory = null: the bytes of memory it needs.
EXPORT int64_t ring_integrate(const Problem* p, Loop* L, double* y, double* rows,
                              int64_t capacity, const double* times, int64_t wanted,
                              double* steps, char* memory) {
  const int F = p->fields;
  auto call = F == 1 ? integrate<1> : F == 2 ? integrate<2> : F == 3 ? integrate<3> : integrate<4>;
  return call(*p, *L, y, rows, capacity, times, wanted, steps, memory);
}
