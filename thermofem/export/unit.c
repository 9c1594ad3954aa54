/* A thermal model, with LIGHT also the light and carriers of a ring, behind the functions of FMI that follow.

   The equations stand in surrogate/export/poles.py and ring_rates.py; this file stands behind the numbers of one model.
   Units inside: ns, fJ, K, 1e23 carriers per m^3; heat and light in W. States: Re a, Im a, N (with LIGHT), then x_k.
   Inputs with LIGHT: power, detuning, in_re, in_im, add_re, add_im; then heat into each heated part. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

enum { FIRST = 3 * LIGHT, STATES = FIRST + POLES, HEAT = 6 * LIGHT, INPUTS = HEAT + HEATED, RTOL = INPUTS };
enum { OUTPUT = 1000, STATE = 2000, DERIVATIVE = 4000 }; /* first value references; inputs and rtol from 0 */

typedef struct {
  double x[STATES], in[INPUTS], rtol, step; /* step: the next one of the co-simulation in ns, 0 at the beginning */
} Unit;

static double linear_rise(const double *poles, int part) {
  double z = 0;
  for (int k = 0; k < POLES; k++) z += READ[part][k] * poles[k];
  return z;
}

static double rise(const double *poles, int part) {
  double z = linear_rise(poles, part);
  return z + COEFFICIENT * z * z;
}

/* dx_k/dt with extra heat in the part that the light heats */
static void heat_flow(const double *poles, const double *in, double light, double *flow) {
  for (int k = 0; k < POLES; k++) {
    flow[k] = -RATE[k] * poles[k] + GAIN[k][LIT] * light;
    for (int i = 0; i < HEATED; i++) flow[k] += GAIN[k][i] * in[HEAT + i];
  }
}

#if LIGHT
typedef struct {
  double shift, slope, energy, turn, damping, absorbed; /* S(N), dS/dN, U, D, gamma, P_abs in W */
} Field;

static Field field(const double *y, double dT, const double *in) {
  Field f;
  double n = y[2], square = n * n + EPSILON * EPSILON;
  f.shift = f.slope = 0;
  for (int k = 0; k < TERMS; k++) {
    double power = DISPERSION[k] * pow(square, 0.5 * (EXPONENT[k] - 1));
    f.shift += power * n;
    f.slope += power * (1 + (EXPONENT[k] - 1) * n * n / square);
  }
  f.energy = y[0] * y[0] + y[1] * y[1];
  f.turn = -THERMAL_SHIFT * dT - f.shift - KERR * f.energy - 6.283185307179586e-9 * in[1];
  double nonlinear = FCA * n + TPA * f.energy;
  f.damping = LOSS + nonlinear;
  f.absorbed = 2e-6 * (ABSORBED + nonlinear) * f.energy;
  return f;
}

static double bus_field(const double *in) { return sqrt(in[0] > 0 ? in[0] : 0) + in[2]; }

static Field light_flow(const double *y, double dT, const double *in, double *flow) {
  Field f = field(y, dT, in);
  flow[0] = -f.turn * y[1] - f.damping * y[0] - PUMP * in[3] - ADD * in[5];
  flow[1] = f.turn * y[0] - f.damping * y[1] + PUMP * bus_field(in) + ADD * in[4];
  flow[2] = G * f.energy * f.energy - y[2] * (1 + B * y[2]) / (TAU0 * (1 + A * y[2]));
  return f;
}
#endif

static void flow(const double *x, const double *in, double *out) {
#if LIGHT
  Field f = light_flow(x, rise(x + FIRST, CORE), in, out);
  heat_flow(x + FIRST, in, f.absorbed, out + FIRST);
#else
  heat_flow(x, in, 0, out);
#endif
}

#if LIGHT
/* One step h in ns of Rodas4 (Hairer and Wanner, Solving ODEs II, 2nd ed., IV.7); the poles are eliminated, so that a
   step solves a system of three. Returns the error in units of the tolerance. */
static const double STAGE[6][5] = {
    {0},
    {1.544},
    {0.9466785280815826, 0.2557011698983284},
    {3.314825187068521, 2.896124015972201, 0.9986419139977817},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1}};
static const double MIXED[6][5] = {
    {0},
    {-5.6688},
    {-2.430093356833875, -0.2063599157091915},
    {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
    {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616},
    {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054}};

static double rodas4(const double *y, double h, const double *in, double *out, double rtol) {
  double k[6][STATES], z[STATES], now[STATES], damp[POLES], M[3][3], I[3][3], gain = 0, s = 1 / (0.25 * h);
  const double linear = linear_rise(y + FIRST, CORE), bend = 1 + 2 * COEFFICIENT * linear;
  Field f = light_flow(y, rise(y + FIRST, CORE), in, now);
  for (int j = 0; j < POLES; j++) {
    damp[j] = 1 / (s + RATE[j]);
    gain += READ[CORE][j] * GAIN[j][LIT] * damp[j];
  }
  const double n = y[2], sat = 1 + A * n, by0 = 2 * y[0], by1 = 2 * y[1];
  const double hot = 2e-6 * (ABSORBED + FCA * n + 2 * TPA * f.energy);
  const double heat[3] = {hot * by0, hot * by1, 2e-6 * FCA * f.energy}; /* of P_abs by the light */
  const double warm[3] = {THERMAL_SHIFT * bend * y[1], -THERMAL_SHIFT * bend * y[0], 0}; /* of the light by z */
  const double J[3][3] = {
      {-f.damping - TPA * by0 * y[0] + KERR * by0 * y[1], -f.turn - TPA * by1 * y[0] + KERR * by1 * y[1],
       f.slope * y[1] - FCA * y[0]},
      {f.turn - TPA * by0 * y[1] - KERR * by0 * y[0], -f.damping - TPA * by1 * y[1] - KERR * by1 * y[0],
       -f.slope * y[0] - FCA * y[1]},
      {2 * G * f.energy * by0, 2 * G * f.energy * by1, -(1 + B * n * (2 + A * n)) / (TAU0 * sat * sat)}};
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) M[a][b] = (a == b ? s : 0) - J[a][b] - gain * warm[a] * heat[b];
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) {
      int p = (b + 1) % 3, q = (b + 2) % 3, r = (a + 1) % 3, t = (a + 2) % 3;
      I[a][b] = M[p][r] * M[q][t] - M[p][t] * M[q][r]; /* adjugate */
    }
  const double det = M[0][0] * I[0][0] + M[0][1] * I[1][0] + M[0][2] * I[2][0];
  for (int stage = 0; stage < 6; stage++) {
    double *own = k[stage], right[STATES], back = 0, fed = 0;
    for (int i = 0; i < STATES; i++) {
      z[i] = y[i];
      for (int j = 0; j < stage; j++) z[i] += STAGE[stage][j] * k[j][i];
    }
    flow(z, in, right);
    for (int i = 0; i < STATES; i++)
      for (int j = 0; j < stage; j++) right[i] += MIXED[stage][j] * k[j][i] / h;
    for (int j = 0; j < POLES; j++) back += READ[CORE][j] * damp[j] * right[FIRST + j];
    for (int a = 0; a < 3; a++) right[a] += warm[a] * back;
    for (int a = 0; a < 3; a++) own[a] = (I[a][0] * right[0] + I[a][1] * right[1] + I[a][2] * right[2]) / det;
    for (int a = 0; a < 3; a++) fed += heat[a] * own[a];
    for (int j = 0; j < POLES; j++) own[FIRST + j] = damp[j] * (right[FIRST + j] + GAIN[j][LIT] * fed);
  }
  for (int i = 0; i < STATES; i++) out[i] = z[i] + k[5][i];
  const double *e = k[5], size = fmax(hypot(y[0], y[1]), hypot(out[0], out[1]));
  const double light = hypot(e[0], e[1]) / (size + 1e-2), carriers = e[2] / (fabs(out[2]) + 1e-3);
  const double heated = linear_rise(e + FIRST, CORE) / (fabs(linear_rise(out + FIRST, CORE)) + 1e-2);
  return sqrt((light * light + carriers * carriers + heated * heated) / 3) / rtol;
}

/* Integrate over ``span`` ns with the inputs held; returns 0, or 1 where no step is small enough. */
static int advance(Unit *u, double span) {
  double left = span, out[STATES];
  if (!(u->step > 0)) u->step = 1e-3;
  while (left > 0) {
    int last = u->step >= left * (1 - 1e-9);
    double h = last ? left : u->step, error = rodas4(u->x, h, u->in, out, u->rtol);
    double change = error < 1e300 ? fmin(4, fmax(0.2, 0.9 * pow(error + 1e-12, -0.25))) : 0.1;
    if (error <= 1) {
      memcpy(u->x, out, sizeof out);
      left = last ? 0 : left - h;
      u->step = fmax(h * change, last ? fmin(u->step, 4 * h * change) : 0);
    } else {
      u->step = h * change;
      if (u->step < 1e-9) return 1;
    }
  }
  return 0;
}
#else
/* The poles over ``span`` ns with the inputs held: exact. */
static int advance(Unit *u, double span) {
  for (int k = 0; k < POLES; k++) {
    double heat = 0;
    for (int i = 0; i < HEATED; i++) heat += GAIN[k][i] * u->in[i];
    u->x[k] = exp(-RATE[k] * span) * u->x[k] - expm1(-RATE[k] * span) / RATE[k] * heat;
  }
  return 0;
}
#endif

static void cold(Unit *u) {
  memset(u, 0, sizeof *u);
  u->rtol = 1e-6;
}

static int is_state(unsigned v) { return v >= STATE && v < STATE + STATES; }

static int set_value(Unit *u, unsigned v, double value) {
  if (v < INPUTS) u->in[v] = value;
  else if (LIGHT && v == RTOL) u->rtol = value;
  else if (is_state(v)) u->x[v - STATE] = value;
  else return 1;
  return 0;
}

static double get_value(const Unit *u, unsigned v) {
  if (v < INPUTS) return u->in[v];
  if (v == RTOL) return u->rtol;
  if (is_state(v)) return u->x[v - STATE];
  if (v >= DERIVATIVE && v < DERIVATIVE + STATES) {
    double out[STATES];
    flow(u->x, u->in, out);
    return out[v - DERIVATIVE] * 1e9;
  }
  if (v >= OUTPUT && v < OUTPUT + PARTS) return rise(u->x + FIRST, v - OUTPUT);
#if LIGHT
  Field f = field(u->x, rise(u->x + FIRST, CORE), u->in);
  double through[2] = {bus_field(u->in) - THROUGH * u->x[1], u->in[3] + THROUGH * u->x[0]};
  double drop[2] = {u->in[4] - DROP * u->x[1], u->in[5] + DROP * u->x[0]};
  switch (v - OUTPUT - PARTS) {
    case 0: return drop[0] * drop[0] + drop[1] * drop[1];
    case 1: return through[0] * through[0] + through[1] * through[1];
    case 2: return f.absorbed;
    case 3: return u->x[2] * 1e23;
    case 4: return f.energy * 1e-15;
    case 5: return through[0];
    case 6: return through[1];
    case 7: return drop[0];
    case 8: return drop[1];
  }
#endif
  return 0;
}
