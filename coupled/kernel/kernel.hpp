// How the parts of the library are called: one type for each kind of system, all memory the caller's.
#pragma once
#include "loop.hpp"

#define EXPORT extern "C" __attribute__((visibility("default")))

template <int N> struct Number { static constexpr int value = N; };
template <class S> struct Type { using System = S; };

// call(Type<System>): the system of F fields that steps on numbers of type T for this problem.
// One ring with one field and poles, the usual one, has its stages unrolled: `fast`.
template <int F, class T, bool fast, class Call>
int64_t with_system(const Problem& p, const Call& call) {
  if (p.heat == QUADRATIC) return call(Type<Single<F, 0, T, Quadratic<T>>>());
  if constexpr (fast)
    return p.method.stages == 6 ? call(Type<Single<F, 6, T, Poles<6, T>>>())
                                : call(Type<Single<F, 8, T, Poles<8, T>>>());
  else
    return call(Type<Single<F, 0, T, Poles<0, T>>>());
}
