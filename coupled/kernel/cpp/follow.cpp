// The derivative of the flow, and that of the equations. Columns of V, size x columns, are replaced by their products
// with it. All return the bytes of memory they need.
#include "kernel.hpp"
#include "slopes.hpp"

// call on numbers with as many derivatives as there are columns, up to `COLUMNS`.
template <class Call> static int64_t on_numbers(int columns, const char* memory, const Call& call) {
  if (memory && !columns) return call(0.0);
  return memory && columns <= 2 ? call(Dual<2>()) : call(Dual<COLUMNS>());
}

// The `count` steps of these lengths again, from y0 to y_end.
EXPORT int64_t ring_follow(const Problem* p, const double* y0, const double* steps, int64_t count, double* y_end,
                           double* V, int columns, char* memory) {
  return on_numbers(columns, memory, [&](auto number) {
    using T = decltype(number);
    auto call = [&](auto system) -> int64_t {
      Arena arena = {memory};
      follow<T, typename decltype(system)::type>(*p, y0, steps, count, y_end, V, columns, arena);
      return arena.used;
    };
    return p->light != SINGLE ? call(Type<Network<T>>()) : alone<1, T>(*p, call);
  });
}

// dy/dt in a piece of the drive at the time t.
EXPORT int64_t ring_slopes(const Problem* p, const double* y, int piece, double t, double* dy, double* V, int columns,
                           char* memory) {
  return on_numbers(columns, memory, [&](auto number) -> int64_t {
    using T = decltype(number);
    const int F = p->fields;
    auto call = F == 1 ? slopes_at<1, T> : F == 2 ? slopes_at<2, T> : F == 3 ? slopes_at<3, T> : slopes_at<4, T>;
    Arena arena = {memory};
    call(*p, y, piece, t, dy, V, columns, arena);
    return arena.used;
  });
}
