/* A unit and its variables, around what stands before: flow, advance, light_output, and Steps, which advance keeps. */
enum { RTOL = INPUTS, OUTPUT = 1000, STATE = 2000, DERIVATIVE = 4000 }; /* first value references; inputs from 0 */

typedef struct {
  double x[STATES], in[INPUTS], rtol;
  Steps steps;
} Unit;

static void cold(Unit *u) {
  memset(u, 0, sizeof *u);
  u->rtol = 1e-6;
}

static int is_state(unsigned v) { return v >= STATE && v < STATE + STATES; }

static int set_value(Unit *u, unsigned v, double value) {
  if (v < INPUTS) u->in[v] = value;
  else if (v == RTOL) u->rtol = value;
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
  return light_output(u->x, u->in, v - OUTPUT - PARTS);
}

/* Over ``span`` ns with the inputs held; returns 0, or 1 where no step is small enough. */
static int advance_unit(Unit *u, double span) { return advance(u->x, u->in, u->rtol, &u->steps, span); }
