#include "kernel.hpp"

// Integrates on from y; returns why it came back. With memory = null: the bytes of memory it needs.
EXPORT int64_t ring_integrate(const Problem* p, Loop* L, double* y, double* rows,
                              int64_t capacity, const double* times, int64_t wanted,
                              double* steps, char* memory) {
  auto fields = [&](auto f) {
    constexpr int F = decltype(f)::value;
    return with_system<F, double, F == 1>(*p, [&](auto type) -> int64_t {
      Arena arena = {memory};
      Integration<F, typename decltype(type)::System> integration(*p, *L, y, rows, arena);
      if (!memory) return (int64_t)arena.used;
      return integration.run(capacity, times, wanted, steps);
    });
  };
  switch (p->fields) {
    case 1: return fields(Number<1>());
    case 2: return fields(Number<2>());
    case 3: return fields(Number<3>());
    default: return fields(Number<4>());
  }
}
