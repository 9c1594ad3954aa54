// Closed orbits of one ring in a fraction of a millisecond, for maps: Newton's method on the return of the carriers,
// y_0 -> y(T), where N rises again through its value in y_0.
//
// Light, carriers and fast heat forget in a turn where they began. So Newton's method is for the slow heat, n states,
// alone, and all others are what the last turn returned. With the n columns of M, the derivative of the return map by
// the slow heat, and dT, that of its duration,
//
//   (1 - M_slow) b = y_slow(T) - y_slow(0),      y_0 <- y(T) + M b,      T <- T + dT b.
//
// M is that of a neighbour in the map until a trace comes near, and then follows from its steps. Broyden's updates
// correct it from turn to turn.
#include "kernel.hpp"
constexpr double SMALLEST = 0.02;  // rtol is times the relative range of N, or times this if larger
constexpr double NEAR = 1e-3;      // relative step of Newton's method, below which traces are fine
constexpr double CLOSED = 30;      // largest last step, in tolerances of the traces
constexpr double SAME = 4e-7;      // largest relative error of the T that the step before predicted
constexpr double MOVED = 2e-3;     // sum of the steps since M was computed, above which it is anew
constexpr double LARGEST = 0.3;    // relative step of Newton's method
constexpr double LONGER = 2.5;     // T over its first guess, above which there is no orbit
constexpr int TURNS = 14;          // most steps of Newton's method

// The longest step beside the fixed point that is nearest to a row; with more it stayed on one.
static double longest_step(const ReturnMap& c, const double* row) {
  const double U = row[1] * row[1] + row[2] * row[2];
  double nearest = INFINITY, longest = INFINITY;
  for (int64_t k = 0; k < c.fixed_count; k++) {
    const double* f = c.fixed + 4 * k;
    const double by_carriers = fabs(row[3] / f[1] - 1), by_heat = fabs(row[4] / f[2] - 1);
    const double off = fmax(fabs(U / f[0] - 1), fmax(by_carriers, by_heat));
    if (off < nearest) nearest = off, longest = f[3];
  }
  return longest;
}

// On from y, the states and the time T, for `duration`, or until N rises through `level`, at which y may begin; rows
// and steps are added to those there are. h: the first step, then the next one. Returns as the loop does; FULL: again
// with more room.
EXPORT int ring_turn(ReturnMap* c, double* y, double duration, double level, int above, double rtol, double* h) {
  Loop L = {};
  double& T = y[3 + c->p->order];
  double *rows = c->rows + 5 * c->filled, *steps = c->steps + c->count;
  c->edges[1] = duration;
  L.h = *h, L.rtol = rtol, L.longest = INFINITY, L.per_step = 1;
  L.budget = L.room = c->room - c->count, L.seen = above ? 0 : INFINITY;
  if (level < INFINITY) L.quantity = 2, L.level = level, L.stop = 1;
  const int64_t room = c->room - c->filled;
  int64_t status;
  while ((status = ring_integrate(c->p, &L, y, rows, room, nullptr, 0, steps, c->memory)) == RESTING) {
    L.cap = longest_step(*c, rows + 5 * (L.filled - 1));
    L.rest_step = L.h, L.rest_again = L.accepted + 20, L.h = fmin(L.h, L.cap);
  }
  for (int64_t i = 0; i < L.filled; i++) rows[5 * i] += T;
  c->filled += L.filled, c->count += L.accepted, *h = L.h, T += L.t;
  return status == STEPS ? FULL : (int)status;
}

namespace {
struct Newton {  // of the states y and, after them, the time T
  ReturnMap& c;
  const int m, n;  // states; of slow heat
  double *begin, *end, *expected, *mended, *A, *b, *rate;
  int* pivots;
  Newton(ReturnMap& map, Arena& arena) : c(map), m(3 + map.p->order), n((int)map.n) {
    begin = arena.take<double>(m + 1), end = arena.take<double>(m + 1);
    expected = arena.take<double>(m + 1), mended = arena.take<double>((m + 1) * n);
    A = arena.take<double>(n * n), b = arena.take<double>(n), rate = arena.take<double>(m);
    pivots = arena.take<int>(n);
  }
  void differentiate(double* M) {  // M from the steps of the last trace, whose end stays in the section
    double* dT = M + m * n;
    memset(M, 0, m * n * sizeof(double));
    for (int j = 0; j < n; j++) M[c.slow[j] * n + j] = 1;
    ring_follow(c.p, begin, c.steps, c.count, rate, M, n, c.memory);
    ring_slopes(c.p, end, 0, 0, rate, nullptr, 0, c.memory);
    for (int j = 0; j < n; j++) {
      dT[j] = -M[2 * n + j] / rate[2];
      for (int i = 0; i < m; i++) M[i * n + j] += rate[i] * dT[j];
    }
    memcpy(mended, M, (m + 1) * n * sizeof(double));
  }
  void broyden_update() const {  // by what the last step b did beyond what was expected
    double square = 0;
    for (int j = 0; j < n; j++) square += b[j] * b[j];
    for (int i = 0; i <= m && square > 0; i++)
      for (int j = 0; j < n; j++) mended[i * n + j] += (end[i] - expected[i]) * b[j] / square;
  }
  double step(double warmest) {  // b and its size, of the warmest state of heat
    for (int i = 0; i < n; i++) {
      b[i] = end[c.slow[i]] - begin[c.slow[i]];
      for (int j = 0; j < n; j++) A[i * n + j] = (i == j) - mended[c.slow[i] * n + j];
    }
    factorize(A, pivots, n), substitute(A, pivots, n, b);
    double size = 0;
    for (int i = 0; i < n; i++) size = fmax(size, fabs(b[i]) / warmest);
    return size;
  }
};
}  // namespace

// The orbit of `pulses` rises near y, the states and the period, which are replaced, as is M, size x n, with dT as a
// last row. known: M is a neighbour's; rough, fine: tolerances of traces far from the orbit and near it. Returns DONE,
// FULL, or another number where there is none.
EXPORT int64_t ring_close(ReturnMap* map, double* y, double* M, int pulses, int known, double rough, double fine) {
  ReturnMap& c = *map;
  Loop none = {};
  Arena arena = {c.memory};
  arena.take<char>(ring_integrate(c.p, &none, 0, 0, 0, 0, 0, 0, 0)
                   + ring_follow(c.p, 0, 0, 0, 0, 0, 0, 0) + ring_slopes(c.p, 0, 0, 0, 0, 0, 0, 0));
  Newton newton(c, arena);
  if (!c.memory) return (int64_t)arena.used;
  const int m = newton.m, n = newton.n;
  const double guess = y[m], level = y[2];
  double range = 1, moved = 0, *end = newton.end, *expected = newton.expected, *b = newton.b;
  bool near = false, fresh = false, mends = false;
  if (known) memcpy(newton.mended, M, (m + 1) * n * sizeof(double));
  for (int turn = 0; turn < TURNS; turn++) {
    const double rtol = (near ? fine : rough) * fmin(1, fmax(SMALLEST, range));
    double& T = end[m];
    double warmest = 1e-30, low = INFINITY, high = 0;
    memcpy(newton.begin, y, m * sizeof(double)), memcpy(end, y, m * sizeof(double));
    T = 0, c.filled = c.count = 0;
    for (int pulse = 0; pulse < pulses; pulse++) {
      double h = 0;
      end[2] = level;
      const int status = ring_turn(&c, end, 4 * guess, level, 1, rtol, &h);
      if (status != EVENT) return status == FULL ? FULL : EVENT;
    }
    if (T > LONGER * guess) return EVENT;
    for (int64_t i = 0; i < c.filled; i++) {
      const double* row = c.rows + 5 * i;
      warmest = fmax(warmest, fabs(row[4])), low = fmin(low, row[3]), high = fmax(high, row[3]);
    }
    range = (high - low) / high;
    if (known && mends) newton.broyden_update();
    double size = known ? newton.step(warmest) : 0;
    if (!known || (!fresh && (size < NEAR || turn > 0))) {
      newton.differentiate(M), known = fresh = true, moved = 0;
      size = newton.step(warmest);
    }
    if (!(size < 1e3)) return EVENT;
    const bool last = near && size < CLOSED * fine && fabs(T - expected[m]) < SAME * T;
    const double share = fmin(1, LARGEST / size);
    for (int j = 0; j < n; j++) b[j] *= share;
    for (int i = 0; i <= m; i++) {
      expected[i] = end[i];
      for (int j = 0; j < n; j++) expected[i] += newton.mended[i * n + j] * b[j];
    }
    memcpy(y, expected, m * sizeof(double));
    y[2] = level, y[m] = fmax(expected[m], 0.2 * T), moved += size, mends = true;
    if (last) {
      if (moved > MOVED || pulses > 1) newton.differentiate(M);
      return DONE;
    }
    if (fresh && size < NEAR) mends = near, near = true;
    else if (!near && size > LARGEST) known = false;  // too far for updates
  }
  return EVENT;
}
