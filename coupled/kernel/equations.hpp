// Light, carriers and heat of microrings: the equations, once, on any number type.
//
// A ring holds F fields (resonances) that share carriers N and temperature. Units: ns, fJ, uW, K,
// 1e23/m^3. State: [Re a_0, Im a_0, .. Re a_F-1, Im a_F-1, N] of every ring, then the states x of
// the heat of every ring.
//
//   da_f/dt = (i D_f - gamma_f) a_f + i s_f,    U_f = |a_f|^2,    W_f = 2 sum_g U_g - U_f
//   D_f     = -shift_f dT - turn_f S(N) - kerr_f W_f - detuning_f
//   gamma_f = loss_f + fca_f N + tpa_f W_f
//   dN/dt   = sum_f generation_f U_f W_f - N (1 + b N)/(tau0 (1 + a N))
//   S(N)    = sum_k c_k N (N^2 + eps^2)^((p_k - 1)/2),   N^p without its infinite slope at N = 0
//   P       = 2 sum_f (absorbed_f + fca_f N + tpa_f W_f) U_f,    the absorbed power
//   dT      = z + bend z^2,    z = sum_k x_k, dx_k/dt = gain_k P - rate_k x_k            (poles)
//                              z = C x,       dx/dt = A x + H[x, x] + (G x + B) P    (quadratic)
//
// s_f is the light that comes in. A circuit adds M_ii to i D - gamma: light that a ring sends back
// to itself. Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 1 and 2.1-2.5; factor 2 of
// the light of other resonances: Lin, Painter and Agrawal, Opt. Express 15, 16604 (2007).
#pragma once
#include "dual.hpp"

constexpr int TERMS = 8;               // most terms of S(N)
constexpr double EPS = 1e15 / 1e23;    // of S(N); six orders below the densities that matter

struct Mode { double loss, absorbed, fca, tpa, generation, shift, turn, kerr; };  // of a resonance
struct Carriers { double tau0, a, b; };
struct Term { double c, p; };

template <int F> struct Ring {  // the constants of one ring, by value
  Mode mode[F];
  double recombination, a, b, bend, own_re, own_im, c[TERMS], e[TERMS];
  int terms;
};

// f = d(fields, N)/dt without the light that comes in; returns the absorbed power. `rise` is what
// neighbours add to dT.
// `factor(k, x)` is x^e_k for the term k of S(N): a step has faster ways than pow.
template <int F, class T, class Factor>
inline T optics(const Ring<F>& ring, const T* y, const T& z, const T& rise, const double* detuning,
                T* f, const Factor& factor) {
  const T& N = y[2 * F];
  const T square = N * N + EPS * EPS, dT = z + ring.bend * (z * z) + rise;
  T S = zero<T>(), U[F], all = zero<T>(), heat = zero<T>(), made = zero<T>();
  for (int k = 0; k < ring.terms; k++)
    S += ring.e[k] == 0 ? ring.c[k] * N : ring.c[k] * N * factor(k, square);
  for (int i = 0; i < F; i++) {
    U[i] = y[2 * i] * y[2 * i] + y[2 * i + 1] * y[2 * i + 1];
    if (F > 1) all += U[i];
  }
  for (int i = 0; i < F; i++) {
    const Mode& m = ring.mode[i];
    const T &re = y[2 * i], &im = y[2 * i + 1], W = F > 1 ? 2.0 * all - U[i] : U[i];
    const T lost = m.fca * N + m.tpa * W, gamma = lost + (m.loss - ring.own_re);
    const T D = -(m.shift * dT + m.turn * S + m.kerr * W) + (ring.own_im - detuning[i]);
    f[2 * i] = -(gamma * re + D * im);
    f[2 * i + 1] = D * re - gamma * im;
    made += m.generation * (U[i] * W);
    heat += 2.0 * (lost + m.absorbed) * U[i];
  }
  f[2 * F] = made - N * (ring.b * N + 1.0) * ring.recombination / (ring.a * N + 1.0);
  return heat;
}

// ---- what the caller hands over ---------------------------------------------------------------

// The last k of n pieces with begin(k) <= t; 0 where t lies before all.
template <class Begin> inline int piece_of(int n, double t, const Begin& begin) {
  int low = 0, high = n - 1;
  while (low < high) {
    const int middle = (low + high + 1) / 2;
    if (begin(middle) <= t) low = middle; else high = middle - 1;
  }
  return low;
}

struct Table {  // functions of time: polynomials in t - edges[k] between edges[k] and edges[k + 1]
  int pieces, columns, terms;
  const double *edges, *c;  // pieces + 1; pieces x columns x terms

  int at(double t) const { return piece_of(pieces, t, [&](int k) { return edges[k]; }); }
  const double* piece(int k, int column) const { return c + (k * columns + column) * terms; }
};
inline double polynomial(const double* c, int terms, double u) {
  double x = 0;
  for (int k = terms; k-- > 0;) x = x * u + c[k];
  return x;
}
inline double slope(const double* c, int terms, double u) {
  double x = 0;
  for (int k = terms; k-- > 1;) x = x * u + k * c[k];
  return x;
}

struct Method {  // a Rosenbrock method: tableaus.json and tableaus.py
  int stages, order;
  double gamma;
  const double *a, *c, *dense, *at, *slope;
};
enum { POLES, QUADRATIC };
enum { SINGLE, BUS, LOOPS };  // one ring; light that passes rings along one bus; any other

struct Problem {
  int rings, fields, order, terms, lasers, pieces, heat, light, delays, waves;
  Method method;
  const Mode* modes;             // rings x fields
  const Carriers* carriers;      // rings
  const Term* dispersion;        // rings x terms
  const double *bend, *own;      // rings; rings complex, M_ii
  const double* floor;           // rings x 3: sizes of field, N and dT below which errors are not
                                 // relative to them
  // heat, `order` states a ring. Poles: gain and rate, rings x order. In a circuit z = sum_k read_k
  // x_k, rings x order, and the heat of neighbours adds sum_jk cross_ijk x_jk (or null) to dT_i.
  const double *gain, *rate, *read, *cross;
  const double *A, *H, *G, *B, *C, *weight;  // quadratic; weight: K of error a unit of each state
  // drive
  const double* edges;           // pieces + 1: a step ends at each
  Table power, phase, detuning;  // columns: lasers, lasers, rings x fields
  const double* entry;           // rings x fields x lasers complex, amplitude for each sqrt(power)
  const double* brightest;       // lasers: largest power
  // circuit
  const int* sequence;           // rings in the order in which light passes them along a bus
  const double *between, *taken, *sent;  // M: rings x rings complex; on a bus taken_i sent_j
  const double *delay, *late;    // delays; rings x delays complex, what comes in from each
  const double *seen_ring, *seen_laser, *seen_late;  // waves x rings, lasers, delays complex
  const double* corner;          // waves or null: 1/ns of the detectors, 0 for none
  int energies;                  // whether the energy of every wave since the start is kept
  double hair;                   // ns by which the times of fronts may be off by round-off
};

// dx_k/dt of quadratic heat.
template <class T> inline T quadratic(const Problem& p, int k, const T* x, const T& P) {
  const int n = p.order;
  T sum = p.B[k] * P;
  for (int j = 0; j < n; j++) {
    T m = P * p.G[k * n + j] + p.A[k * n + j];
    for (int l = 0; l < n; l++) m += p.H[(k * n + j) * n + l] * x[l];
    sum += m * x[j];
  }
  return sum;
}
template <int F> inline Ring<F> ring_of(const Problem& p, int i) {
  Ring<F> r;
  for (int f = 0; f < F; f++) r.mode[f] = p.modes[i * F + f];
  const Carriers& c = p.carriers[i];
  r.recombination = 1 / c.tau0, r.a = c.a, r.b = c.b, r.bend = p.bend[i];
  r.own_re = p.own[2 * i], r.own_im = p.own[2 * i + 1], r.terms = p.terms;
  for (int k = 0; k < p.terms; k++) {
    const Term& t = p.dispersion[i * p.terms + k];
    r.c[k] = t.c, r.e[k] = 0.5 * (t.p - 1);
  }
  return r;
}

// The light that comes in and the detunings at one time: rings x fields, amplitudes complex.
struct Light { double *in, *detuning, *in_slope, *detuning_slope; };
struct Places { int power, phase, detuning; };  // pieces of the three tables
inline Places places_of(const Problem& p, int piece) {
  const double middle = 0.5 * (p.edges[piece] + p.edges[piece + 1]);
  return {p.power.at(middle), p.phase.at(middle), p.detuning.at(middle)};
}

// The wave of a laser, and its slope. The slope of sqrt(P) has no bound where P leaves 0; as an
// ingredient of the step, not of the equations, it is bounded below 1e-12 of its largest power.
inline void laser_at(const Problem& p, const Places& at, int laser, double t, double* wave,
                     double* rising) {
  const double *c = p.power.piece(at.power, laser), *q = p.phase.piece(at.phase, laser);
  const double u = t - p.power.edges[at.power], v = t - p.phase.edges[at.phase];
  const double P = polynomial(c, p.power.terms, u), size = sqrt(P > 0 ? P : 0);
  const double growth = 0.5 * slope(c, p.power.terms, u) * size
                        / fmax(size * size + 1e-12 * p.brightest[laser], 1e-300);
  const double phase = polynomial(q, p.phase.terms, v), turn = slope(q, p.phase.terms, v);
  const double co = phase == 0 ? 1 : cos(phase), si = phase == 0 ? 0 : sin(phase);
  wave[0] = size * co, wave[1] = size * si;
  rising[0] = growth * co - turn * wave[1], rising[1] = growth * si + turn * wave[0];
}
inline void light_at(const Problem& p, const Places& at, double t, const Light& l) {
  const int n = p.rings * p.fields;
  memset(l.in, 0, 2 * n * sizeof(double));
  memset(l.in_slope, 0, 2 * n * sizeof(double));
  for (int i = 0; i < n; i++) {
    const double *c = p.detuning.piece(at.detuning, i), u = t - p.detuning.edges[at.detuning];
    l.detuning[i] = polynomial(c, p.detuning.terms, u);
    l.detuning_slope[i] = slope(c, p.detuning.terms, u);
  }
  for (int k = 0; k < p.lasers; k++) {
    double wave[2], rising[2];
    laser_at(p, at, k, t, wave, rising);
    for (int i = 0; i < n; i++) {
      const double* e = p.entry + 2 * (i * p.lasers + k);
      add_product(l.in + 2 * i, e, wave), add_product(l.in_slope + 2 * i, e, rising);
    }
  }
}
