// Light, carriers and heat of microrings: the equations, once, on any number type.
//
// A ring holds F fields (resonances) that share carriers N and temperature. Units: ns, fJ, uW, K, 1e23/m^3.
// State: [Re a_0, Im a_0, .. Re a_F-1, Im a_F-1, N] of every ring, then the states x of the heat of every ring.
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
// s_f is the light that comes in. A circuit adds M_ii to i D - gamma: light that a ring sends back to itself.
// Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 1 and 2.1-2.5; factor 2 of the light of other
// resonances: Lin, Painter and Agrawal, Opt. Express 15, 16604 (2007).
#pragma once
#include "dual.hpp"
constexpr int TERMS = 8;               // most terms of S(N)
constexpr double EPS = 1e15 / 1e23;    // of S(N); six orders below the densities that matter

struct Mode { double loss, absorbed, fca, tpa, generation, shift, turn, kerr; };  // of a resonance
struct Carriers { double tau0, a, b; };
struct Term { double c, p; double exponent() const { return 0.5 * (p - 1); } };
template <int F> struct Ring {  // the constants of one ring, by value
  Mode mode[F];
  Carriers carriers;
  Term term[TERMS];
  double bend, own_re, own_im;
  int terms;
};

// f = d(fields, N)/dt without the light that comes in; returns the absorbed power. `rise` is what neighbours add to
// dT. `factor(k, x)` is x^exponent for the term k of S(N): a step has faster ways than pow.
template <int F, class T, class Factor>
inline T optics(const Ring<F>& ring, const T* y, const T& z, const T& rise,
                const Dual<1>* detuning, T* f, const Factor& factor) {
  const T& N = y[2 * F];
  const T square = N * N + EPS * EPS, dT = z + ring.bend * (z * z) + rise;
  T S = zero<T>(), U[F], all = zero<T>(), heat = zero<T>(), made = zero<T>();
  for (int k = 0; k < ring.terms; k++) {
    const Term& term = ring.term[k];
    S += term.p == 1 ? term.c * N : term.c * N * factor(k, square);
  }
  for (int i = 0; i < F; i++) {
    U[i] = y[2 * i] * y[2 * i] + y[2 * i + 1] * y[2 * i + 1];
    if (F > 1) all += U[i];
  }
  for (int i = 0; i < F; i++) {
    const Mode& m = ring.mode[i];
    const T &re = y[2 * i], &im = y[2 * i + 1], W = F > 1 ? 2.0 * all - U[i] : U[i];
    const T lost = m.fca * N + m.tpa * W, gamma = lost + (m.loss - ring.own_re);
    const T D = -(m.shift * dT + m.turn * S + m.kerr * W) + (ring.own_im - detuning[i].v);
    f[2 * i] = -(gamma * re + D * im);
    f[2 * i + 1] = D * re - gamma * im;
    made += m.generation * (U[i] * W);
    heat += 2.0 * (lost + m.absorbed) * U[i];
  }
  const Carriers& c = ring.carriers;
  f[2 * F] = made - N * (c.b * N + 1.0) / (c.tau0 * (c.a * N + 1.0));
  return heat;
}

template <class T> inline T polynomial(const double* c, int terms, const T& u) {
  T x = zero<T>();
  for (int k = terms; k-- > 0;) x = x * u + c[k];
  return x;
}
struct Table {  // functions of time: in each piece of the drive polynomials in t - edges[place]
  int columns, terms;
  const int* place;         // pieces of the drive
  const double *edges, *c;  // places; places x columns x terms
  Dual<1> at(int piece, int column, double t) const {  // with its slope
    const int k = place[piece];
    return polynomial(c + (k * columns + column) * terms, terms, seeded<1>(t - edges[k], 0));
  }
};

struct Method {  // a Rosenbrock method: tableaus.json and tableaus.py
  int stages, order;
  double gamma;
  const double *a, *c, *dense, *at, *slope;
};
enum { POLES, QUADRATIC };
enum { SINGLE, BUS, LOOPS };  // one ring; light that passes rings along one bus; any other

struct Problem {  // what the caller hands over
  int rings, fields, order, terms, lasers, pieces, heat, light, delays, waves;
  Method method;
  const Mode* modes;             // rings x fields
  const Carriers* carriers;      // rings
  const Term* dispersion;        // rings x terms
  const double *bend, *own;      // rings; rings complex, M_ii
  const double* floor;           // rings x 3: sizes of field, N and dT below which errors are not relative to them
  // heat, `order` states a ring: z = sum_k read_k x_k, rings x order; weight: K of error a unit of each state.
  // Poles: gain and rate, rings x order. The heat of neighbours adds sum_jk cross_ijk x_jk (or null) to dT_i.
  const double *read, *weight, *gain, *rate, *cross;
  const double *A, *H, *G, *B;   // quadratic
  // drive
  const double* edges;           // pieces + 1: a step ends at each
  const int *jumps, *varies;     // pieces: whether the drive does at the start, and within
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
  double time_tolerance;         // ns by which the times of fronts may be off by round-off
};

// A + share H[x, .] + G P of quadratic heat: with share = 1 dx/dt is this times x, plus B P; with 2 its derivative.
template <class T>
inline T quadratic(const Problem& p, int k, int j, double share, const T* x, const T& P) {
  const int n = p.order, at = k * n + j;
  T bent = zero<T>();
  for (int l = 0; l < n; l++) bent += p.H[at * n + l] * x[l];
  return P * p.G[at] + p.A[at] + share * bent;
}
template <int F> inline Ring<F> ring_of(const Problem& p, int i) {
  Ring<F> r;
  memcpy(r.mode, p.modes + i * F, sizeof r.mode);
  memcpy(r.term, p.dispersion + i * p.terms, p.terms * sizeof(Term));
  r.carriers = p.carriers[i], r.bend = p.bend[i], r.terms = p.terms;
  r.own_re = p.own[2 * i], r.own_im = p.own[2 * i + 1];
  return r;
}

// The light that comes in, rings x fields complex, and the detunings, with their slopes in time.
struct Light { Dual<1> *in, *detuning; };

// The wave of a laser. The slope of sqrt(P) has no bound where P leaves 0; as an ingredient of the step, not of the
// equations, it is bounded below 1e-12 of its largest power.
inline void laser_at(const Problem& p, int piece, int laser, double t, Dual<1>* wave) {
  const Dual<1> P = p.power.at(piece, laser, t), phase = p.phase.at(piece, laser, t);
  const double root = sqrt(P.v > 0 ? P.v : 0);
  const double near = fmax(root * root + 1e-12 * p.brightest[laser], 1e-300);
  const double co = phase.v == 0 ? 1 : cos(phase.v), si = phase.v == 0 ? 0 : sin(phase.v);
  const Dual<1> size = {root, {0.5 * P.d[0] * root / near}};
  wave[0] = size * Dual<1>{co, {-si * phase.d[0]}};
  wave[1] = size * Dual<1>{si, {co * phase.d[0]}};
}
inline void light_at(const Problem& p, int piece, double t, const Light& l) {
  const int n = p.rings * p.fields;
  memset(l.in, 0, 2 * n * sizeof *l.in);
  for (int i = 0; i < n; i++) l.detuning[i] = p.detuning.at(piece, i, t);
  for (int k = 0; k < p.lasers; k++) {
    Dual<1> wave[2];
    laser_at(p, piece, k, t, wave);
    for (int i = 0; i < n; i++) add_product(l.in + 2 * i, p.entry + 2 * (i * p.lasers + k), wave);
  }
}
