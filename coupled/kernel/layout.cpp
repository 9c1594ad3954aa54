// Where the fields of the structures lie that a caller fills: structures.py compares when it loads.
#include <stddef.h>
#include "kernel.hpp"

struct Place { const char* name; int64_t bytes; };  // of a field from the start, and of a whole

#define FIELD(type, field) {#type "." #field, (int64_t)offsetof(type, field)}
#define WHOLE(type) {#type, (int64_t)sizeof(type)}

// Null ends the table. A field that it lacks changes the size of the whole, or where others lie.
EXPORT const Place* ring_layout() {
  static const Place places[] = {
      FIELD(Table, columns), FIELD(Table, terms), FIELD(Table, place), FIELD(Table, edges),
      FIELD(Table, c), WHOLE(Table),
      FIELD(Method, stages), FIELD(Method, order), FIELD(Method, gamma), FIELD(Method, a),
      FIELD(Method, c), FIELD(Method, dense), FIELD(Method, at), FIELD(Method, slope),
      WHOLE(Method),
      FIELD(Problem, rings), FIELD(Problem, fields), FIELD(Problem, order), FIELD(Problem, terms),
      FIELD(Problem, lasers), FIELD(Problem, pieces), FIELD(Problem, heat), FIELD(Problem, light),
      FIELD(Problem, delays), FIELD(Problem, waves), FIELD(Problem, method), FIELD(Problem, modes),
      FIELD(Problem, carriers), FIELD(Problem, dispersion), FIELD(Problem, bend),
      FIELD(Problem, own), FIELD(Problem, floor), FIELD(Problem, read), FIELD(Problem, weight),
      FIELD(Problem, gain), FIELD(Problem, rate), FIELD(Problem, cross), FIELD(Problem, A),
      FIELD(Problem, H), FIELD(Problem, G), FIELD(Problem, B), FIELD(Problem, edges),
      FIELD(Problem, jumps), FIELD(Problem, varies), FIELD(Problem, power), FIELD(Problem, phase),
      FIELD(Problem, detuning), FIELD(Problem, entry), FIELD(Problem, brightest),
      FIELD(Problem, sequence), FIELD(Problem, between), FIELD(Problem, taken),
      FIELD(Problem, sent), FIELD(Problem, delay), FIELD(Problem, late), FIELD(Problem, seen_ring),
      FIELD(Problem, seen_laser), FIELD(Problem, seen_late), FIELD(Problem, corner),
      FIELD(Problem, energies), FIELD(Problem, time_tolerance), WHOLE(Problem),
      FIELD(Loop, t), FIELD(Loop, h), FIELD(Loop, h_before), FIELD(Loop, size_before),
      FIELD(Loop, growth), FIELD(Loop, rtol), FIELD(Loop, longest), FIELD(Loop, restart),
      FIELD(Loop, cap), FIELD(Loop, rest_step), FIELD(Loop, level), FIELD(Loop, seen),
      FIELD(Loop, crossing), FIELD(Loop, accepted), FIELD(Loop, rejected),
      FIELD(Loop, rest_again), FIELD(Loop, filled), FIELD(Loop, room), FIELD(Loop, budget),
      FIELD(Loop, begun), FIELD(Loop, piece), FIELD(Loop, entered), FIELD(Loop, fresh),
      FIELD(Loop, per_step), FIELD(Loop, quantity), FIELD(Loop, ring), FIELD(Loop, stop),
      FIELD(Loop, past), {"Loop.past_filled", offsetof(Loop, past) + offsetof(Past, filled)},
      {"Loop.past_room", offsetof(Loop, past) + offsetof(Past, room)}, WHOLE(Loop),
      {nullptr, 0}};
  return places;
}
