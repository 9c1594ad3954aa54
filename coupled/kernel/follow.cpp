// The derivative of the flow, and that of the equations.
#include "kernel.hpp"
#include "slopes.hpp"

constexpr int COLUMNS = 7;  // directions at once; and the value: a line of the cache

// The `count` steps of these lengths again, from y0 to y_end; V, size x columns, is replaced by its
// product with the derivative of the flow. Returns the bytes of memory it needs.
EXPORT int64_t ring_follow(const Problem* p, const double* y0, const double* steps, int64_t count,
                           double* y_end, double* V, int columns, char* memory) {
  auto with = [&](auto number, auto directions) {
    using T = decltype(number);
    return with_system<1, T, false>(*p, [&](auto type) -> int64_t {
      Arena arena = {memory};
      follow<1, decltype(directions)::value, T, typename decltype(type)::System>(
          *p, y0, steps, count, y_end, V, columns, arena);
      return (int64_t)arena.used;
    });
  };
  if (memory && !columns) return with(0.0, Number<0>());
  if (memory && columns <= 2) return with(Dual<2>(), Number<2>());
  return with(Dual<COLUMNS>(), Number<COLUMNS>());
}

// dy/dt and its derivative J (size x size) in a piece of the drive at the time t.
EXPORT int64_t ring_slopes(const Problem* p, const double* y, int piece, double t, double* dy,
                           double* J, char* memory) {
  Arena arena = {memory};
  const Light light = light_of(arena, p->rings * p->fields);
  if (!memory) return (int64_t)arena.used;
  light_at(*p, places_of(*p, piece), t, light);
  const int F = p->fields;
  auto call = F == 1 ? slopes<1> : F == 2 ? slopes<2> : F == 3 ? slopes<3> : slopes<4>;
  call(*p, light, y, dy, J);
  return 0;
}
