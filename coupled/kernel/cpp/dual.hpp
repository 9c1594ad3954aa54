// Dual numbers: a value and its derivatives by C numbers. A function written once for any number type T gives values
// with T = double, Jacobians with Dual<C>, and derivatives of a whole step, whose ingredients are Jacobians, with
// Dual<C, Dual<...>>.
#pragma once
#include <math.h>
#include <stdint.h>
#include <string.h>

template <int C, class S = double> struct Dual { S v, d[C]; };
template <class T> inline T zero() { T r; memset(&r, 0, sizeof r); return r; }
inline double value(double x) { return x; }
template <int C, class S> inline double value(const Dual<C, S>& x) { return value(x.v); }
template <class T> inline double magnitude(const T& x) { return fabs(value(x)); }

#define DUAL template <int C, class S> inline Dual<C, S>
#define DERIVATIVES(expression) for (int i = 0; i < C; i++) r.d[i] = expression; return r

DUAL operator+(const Dual<C, S>& a, const Dual<C, S>& b) {
  Dual<C, S> r; r.v = a.v + b.v; DERIVATIVES(a.d[i] + b.d[i]);
}
DUAL operator-(const Dual<C, S>& a, const Dual<C, S>& b) {
  Dual<C, S> r; r.v = a.v - b.v; DERIVATIVES(a.d[i] - b.d[i]);
}
DUAL operator*(const Dual<C, S>& a, const Dual<C, S>& b) {
  Dual<C, S> r; r.v = a.v * b.v; DERIVATIVES(a.d[i] * b.v + a.v * b.d[i]);
}
DUAL operator/(const Dual<C, S>& a, const Dual<C, S>& b) {
  Dual<C, S> r; S q = 1.0 / b.v; r.v = a.v * q; DERIVATIVES((a.d[i] - r.v * b.d[i]) * q);
}
DUAL operator-(const Dual<C, S>& a) { Dual<C, S> r; r.v = -a.v; DERIVATIVES(-a.d[i]); }
DUAL operator+(const Dual<C, S>& a, double b) { Dual<C, S> r = a; r.v = a.v + b; return r; }
DUAL operator+(double b, const Dual<C, S>& a) { return a + b; }
DUAL operator-(const Dual<C, S>& a, double b) { return a + -b; }
DUAL operator-(double b, const Dual<C, S>& a) { return -a + b; }
DUAL operator*(const Dual<C, S>& a, double b) { Dual<C, S> r; r.v = a.v * b; DERIVATIVES(a.d[i] * b); }
DUAL operator*(double b, const Dual<C, S>& a) { return a * b; }
DUAL operator/(double b, const Dual<C, S>& a) {
  Dual<C, S> r; S q = 1.0 / a.v; r.v = b * q; S m = -(r.v * q); DERIVATIVES(m * a.d[i]);
}
DUAL& operator+=(Dual<C, S>& a, const Dual<C, S>& b) { return a = a + b; }
DUAL& operator-=(Dual<C, S>& a, const Dual<C, S>& b) { return a = a - b; }
inline double power(double x, double p) { return exp(p * log(x)); }
DUAL power(const Dual<C, S>& x, double p) {
  Dual<C, S> r; r.v = power(x.v, p); S s = p * r.v / x.v; DERIVATIVES(s * x.d[i]);
}
// sum += a b of complex numbers.
template <class T, class S> inline void add_product(T* sum, const double* a, const S* b) {
  sum[0] += a[0] * b[0] - a[1] * b[1], sum[1] += a[0] * b[1] + a[1] * b[0];
}
// v as the variable number `at`.
template <int C, class S> inline Dual<C, S> seeded(const S& v, int at) {
  Dual<C, S> r = zero<Dual<C, S>>();
  r.v = v, r.d[at] = zero<S>() + 1.0;
  return r;
}
#undef DUAL
#undef DERIVATIVES

// end = f(y0), n numbers, and the columns of V, n x columns, become their products with df/dy. T:
// numbers with C derivatives, or double with no columns. f(y) returns where its values stand.
template <class T, class Map>
void differentiate(int n, const double* y0, double* end, double* V, int columns, T* y, const Map& f) {
  constexpr int C = sizeof(T) / sizeof(double) - 1;
  for (int first = 0; first == 0 || first < columns; first += C ? C : 1) {
    for (int i = 0; i < n; i++) {
      y[i] = zero<T>() + y0[i];
      if constexpr (C > 0)
        for (int c = 0; c < C && first + c < columns; c++) y[i].d[c] = V[i * columns + first + c];
    }
    const T* image = f(y);
    for (int i = 0; i < n; i++) {
      end[i] = value(image[i]);
      if constexpr (C > 0)
        for (int c = 0; c < C && first + c < columns; c++) V[i * columns + first + c] = image[i].d[c];
    }
  }
}
