// The integration that Python calls: one ring with up to four fields, or a circuit.
#include "kernel.hpp"

// Integrates on from y; returns why it came back. With memory = null: the bytes of memory it needs.
EXPORT int64_t ring_integrate(const Problem* problem, Loop* L, double* y, double* rows, int64_t capacity,
                              const double* times, int64_t wanted, double* steps, char* memory) {
  const Problem& p = *problem;
  auto call = [&](auto system) -> int64_t {
    Arena arena = {memory};
    Integration<typename decltype(system)::type> integration(p, *L, y, rows, arena);
    return memory ? integration.run(capacity, times, wanted, steps) : (int64_t)arena.used;
  };
  if (p.light != SINGLE) return call(Type<Network<double>>());
  if (p.fields == 1 && p.heat == POLES)  // the usual one has its stages unrolled
    return p.method.stages == 6 ? call(Type<Single<1, 6, double, Poles<double>>>())
                                : call(Type<Single<1, 8, double, Poles<double>>>());
  return p.fields == 1   ? alone<1, double>(p, call)
         : p.fields == 2 ? alone<2, double>(p, call)
         : p.fields == 3 ? alone<3, double>(p, call) : alone<4, double>(p, call);
}
