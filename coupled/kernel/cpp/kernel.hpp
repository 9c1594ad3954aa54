// How the parts of the library are called: a type for each kind of system, all memory the caller's.
#pragma once
#include "network.hpp"
#define EXPORT extern "C" __attribute__((visibility("default")))

EXPORT int64_t ring_integrate(const Problem*, Loop*, double* y, double* rows, int64_t capacity,
                              const double* times, int64_t wanted, double* steps, char* memory);
EXPORT int64_t ring_follow(const Problem*, const double* y0, const double* steps, int64_t count,
                           double* y_end, double* V, int columns, char* memory);
EXPORT int64_t ring_slopes(const Problem*, const double* y, int piece, double t, double* dy,
                           double* V, int columns, char* memory);

struct ReturnMap {  // traces and closed orbits of one ring (shooting.cpp)
  const Problem* p;
  double* edges;        // of p; the last one is where a trace ends
  const double* fixed;  // fixed points: U, N, dT and the longest step beside each
  const int* slow;      // states of slow heat
  double *rows, *steps; // of the last trace: t, field, N, dT; lengths
  int64_t fixed_count, n, room, filled, count;  // n: of slow; room: for rows
  char* memory;         // of as many bytes as `ring_close` asks for where it is null
};

// call(Type<System>): one ring with F fields that steps on numbers of type T.
template <class X> struct Type { using type = X; };
template <int F, class T, class Call> int64_t alone(const Problem& p, const Call& call) {
  return p.heat == QUADRATIC ? call(Type<Single<F, 0, T, Quadratic<T>>>())
                             : call(Type<Single<F, 0, T, Poles<T>>>());
}
