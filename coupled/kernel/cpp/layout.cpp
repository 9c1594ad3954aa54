// Where the fields of the structures lie that a caller fills: library.py compares when it loads,
// and the page (kernel.mjs) fills them by this table.
#include <stddef.h>
#include "kernel.hpp"
struct Place { const char* name; int64_t bytes; };  // of a field from the start, and of a whole

#define FIELD(type, field) {#type "." #field, (int64_t)offsetof(type, field)}
#define WHOLE(type) {#type, (int64_t)sizeof(type)}
#define T(field) FIELD(Table, field)
#define M(field) FIELD(Method, field)
#define P(field) FIELD(Problem, field)
#define L(field) FIELD(Loop, field)
#define R(field) FIELD(ReturnMap, field)

// Null ends the table. A field that it lacks changes the size of the whole, or where others lie.
EXPORT const Place* ring_layout() {
  static const Place places[] = {
      T(columns), T(terms), T(place), T(edges), T(c), WHOLE(Table),
      M(stages), M(order), M(gamma), M(a), M(c), M(dense), M(at), M(slope), WHOLE(Method),
      P(rings), P(fields), P(order), P(terms), P(lasers), P(pieces), P(heat), P(light), P(delays), P(waves),
      P(method), P(modes), P(carriers), P(dispersion), P(bend), P(own), P(floor), P(read), P(weight), P(gain),
      P(rate), P(cross), P(A), P(H), P(G), P(B), P(edges), P(jumps), P(varies), P(power), P(phase), P(detuning),
      P(entry), P(brightest), P(sequence), P(between), P(taken), P(sent), P(delay), P(late), P(seen_ring),
      P(seen_laser), P(seen_late), P(corner), P(energies), P(time_tolerance), WHOLE(Problem),
      L(t), L(h), L(h_before), L(size_before), L(growth), L(rtol), L(longest), L(restart), L(cap), L(rest_step),
      L(level), L(seen), L(crossing), L(accepted), L(rejected), L(rest_again), L(filled), L(room), L(budget),
      L(begun), L(piece), L(entered), L(fresh), L(per_step), L(quantity), L(ring), L(stop), L(past),
      {"Loop.past_filled", offsetof(Loop, past) + offsetof(Past, filled)},
      {"Loop.past_room", offsetof(Loop, past) + offsetof(Past, room)}, WHOLE(Loop),
      R(p), R(edges), R(fixed), R(slow), R(rows), R(steps), R(fixed_count), R(n), R(room), R(filled), R(count),
      R(memory), WHOLE(ReturnMap), {nullptr, 0}};
  return places;
}
