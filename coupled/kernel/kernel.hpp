// How the parts of the library are called: a type for each kind of system, all memory the caller's.
#pragma once
#include "network.hpp"

#define EXPORT extern "C" __attribute__((visibility("default")))

EXPORT int64_t ring_integrate(const Problem*, Loop*, double* y, double* rows, int64_t capacity,
                              const double* times, int64_t wanted, double* steps, char* memory);
EXPORT int64_t ring_follow(const Problem*, const double* y0, const double* steps, int64_t count,
                           double* y_end, double* V, int columns, char* memory);
EXPORT int64_t ring_slopes(const Problem*, const double* y, int piece, double t, double* dy,
                           double* J, char* memory);

template <int N> struct Number { static constexpr int value = N; };
template <class S> struct Type { using System = S; };

// call(Type<System>): the system of F fields that steps on numbers of type T for this problem.
// One ring with one field and poles, the usual one, has its stages unrolled: `fast`.
template <int F, class T, bool fast, class Call>
int64_t with_system(const Problem& p, const Call& call) {
  if constexpr (F == 1)
    if (p.light != SINGLE) return call(Type<Network<T>>());
  if (p.heat == QUADRATIC) return call(Type<Single<F, 0, T, Quadratic<T>>>());
  if constexpr (fast)
    return p.method.stages == 6 ? call(Type<Single<F, 6, T, Poles<6, T>>>())
                                : call(Type<Single<F, 8, T, Poles<8, T>>>());
  else
    return call(Type<Single<F, 0, T, Poles<0, T>>>());
}
