/* Heat alone in a unit: each pole is advanced exactly. */
typedef char Steps;

static void flow(const double *x, const double *in, double *out) {
  for (int k = 0; k < ORDER; k++) out[k] = warming(in, k) - RATE[k] * x[k];
}

static int advance(double *x, const double *in, double rtol, Steps *none, double span) {
  for (int k = 0; k < ORDER; k++)
    x[k] = exp(-RATE[k] * span) * x[k] - expm1(-RATE[k] * span) / RATE[k] * warming(in, k);
  return 0;
}

static double light_output(const double *x, const double *in, unsigned which) { return 0; }
