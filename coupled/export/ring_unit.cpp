// A ring in a unit: the equations and the steps are those of coupled/kernel, whose headers stand beside this file.
//
// States: Re a, Im a, N, x_k in the units of equations.hpp. Inputs: power, detuning, in_re, in_im, add_re, add_im in W,
// Hz and sqrt(W); then heat into each part, which is held over a communication step. With q_k of that heat,
//
//   x'_k = x_k - q_k/rate_k,    dx'_k/dt = gain_k P - rate_k x'_k,    z = read x' + z_0,    z_0 = sum_k read_k q_k/rate_k
//   dT   = z + bend z^2 = dT_0 + z' + bend' z'^2,    dT_0 = z_0 + bend z_0^2
//   z'   = (1 + 2 bend z_0) read x',    bend' = bend/(1 + 2 bend z_0)^2
//
// so x' are the poles of a ring without that heat, and dT_0 is one more detuning, shift dT_0.
typedef Loop Steps;
static_assert(sizeof DISPERSION / sizeof *DISPERSION <= TERMS, "too many terms of S(N)");

struct Held {  // the problem of the kernel under inputs that do not change for `span` ns
  double rest[ORDER], read[ORDER], weight[ORDER], gain[ORDER];
  double bend, detuning, entry[2], edges[2], own[2] = {0, 0}, one = 1, zero = 0;
  int none = 0;
  Problem problem = {};
  Held(const double* in, double span) : edges{0, span} {
    double z_0 = 0;
    for (int k = 0; k < ORDER; k++) rest[k] = warming(in, k) / RATE[k];
    for (int k = 0; k < ORDER; k++) z_0 += READ[CORE][k] * rest[k];
    const double slope = 1 + 2 * COEFFICIENT * z_0, dT_0 = z_0 + COEFFICIENT * z_0 * z_0;
    for (int k = 0; k < ORDER; k++) {
      read[k] = slope * READ[CORE][k];
      weight[k] = fabs(read[k]);
      gain[k] = 1e-6 * GAIN[k][LIT];  // the kernel has uW
    }
    bend = COEFFICIENT / (slope * slope);
    detuning = 6.283185307179586e-9 * in[1] + MODE.shift * dT_0;
    entry[0] = PUMP * (sqrt(in[0] > 0 ? in[0] : 0) + in[2]) + ADD * in[4];
    entry[1] = PUMP * in[3] + ADD * in[5];
    Problem& p = problem;
    p.rings = p.fields = p.lasers = p.pieces = 1;
    p.order = ORDER, p.terms = sizeof DISPERSION / sizeof *DISPERSION;
    p.heat = POLES, p.light = SINGLE, p.method = METHOD;
    p.modes = &MODE, p.carriers = &CARRIERS, p.dispersion = DISPERSION, p.floor = FLOOR;
    p.bend = &bend, p.own = own;
    p.read = read, p.weight = weight, p.gain = gain, p.rate = RATE;
    p.edges = edges, p.jumps = p.varies = &none;
    p.power = {1, 1, &none, edges, &one};
    p.phase = {1, 1, &none, edges, &zero};
    p.detuning = {1, 1, &none, edges, &detuning};
    p.entry = entry, p.brightest = &one;
  }
  void enter(const double* x, double* y) const {  // states of the kernel
    for (int i = 0; i < STATES; i++) y[i] = i < FIRST ? x[i] : x[i] - rest[i - FIRST];
  }
  void leave(const double* y, double* x) const {
    for (int i = 0; i < STATES; i++) x[i] = i < FIRST ? y[i] : y[i] + rest[i - FIRST];
  }
};

static void flow(const double* x, const double* in, double* out) {
  const Held held(in, 1);
  double y[STATES];
  Dual<1> wave[2], turn[1];
  const Light light = {wave, turn};
  held.enter(x, y);
  light_at(held.problem, 0, 0, light);
  slopes<1, double>(held.problem, light, y, out);
}

static int advance(double* x, const double* in, double rtol, Steps* steps, double span) {
  using System = Single<1, METHOD.stages, double, Poles<double>>;
  const Held held(in, span);
  Loop& loop = *steps;  // keeps the size of the next step
  loop.t = 0, loop.piece = loop.entered = 0, loop.filled = 0;
  loop.rtol = rtol, loop.per_step = 1, loop.budget = INT64_MAX, loop.seen = INFINITY;
  loop.longest = QUIET_STEP * CARRIERS.tau0;  // resolves every mode that grows: RESTING never comes back
  double y[STATES], row[5];
  held.enter(x, y);
  Arena counted = {nullptr};
  Integration<System> sized(held.problem, loop, y, row, counted);
  char* memory = (char*)malloc(counted.used + 64);
  if (!memory) return 1;
  Arena arena = {memory + (64 - (uintptr_t)memory % 64) % 64};
  Integration<System> integration(held.problem, loop, y, row, arena);
  const bool done = integration.run(1, &span, 1, nullptr) == DONE;
  free(memory);
  if (done) held.leave(y, x);
  return !done;
}

static double absorbed(const double* x, const double* in) {  // W
  const Held held(in, 1);
  const Ring<1> ring = ring_of<1>(held.problem, 0);
  const Dual<1> turn = {0, {0}};
  double f[FIRST];
  return 1e-6 * optics<1, double>(ring, x, 0.0, 0.0, &turn, f, [&](int k, double square) {
    return power(square, ring.term[k].exponent());
  });
}

static double light_output(const double* x, const double* in, unsigned which) {
  const double bus = sqrt(in[0] > 0 ? in[0] : 0) + in[2];
  const double through[2] = {bus - THROUGH * x[1], in[3] + THROUGH * x[0]};
  const double drop[2] = {in[4] - DROP * x[1], in[5] + DROP * x[0]};
  const auto square = [](const double* field) { return field[0] * field[0] + field[1] * field[1]; };
  const double outputs[] = {square(drop), square(through), absorbed(x, in), x[2] * 1e23, square(x) * 1e-15,
                            through[0], through[1], drop[0], drop[1]};
  return outputs[which];
}
