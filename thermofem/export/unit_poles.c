/* The poles of a thermal model in a unit, in C or C++; exports write their numbers before this text.

   dx_k/dt = -RATE_k x_k + sum_i GAIN_ki P_i,    z_j = sum_k READ_jk x_k,    dT_j = z_j + COEFFICIENT z_j^2
   in ns, K, W. States of a unit: FIRST of the light, then x_k. Inputs: HEAT of the light, then heat into each part. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#ifdef __cplusplus
#define PLAIN extern "C"
#else
#define PLAIN
#endif
#ifdef _WIN32
#define API PLAIN __declspec(dllexport)
#else
#define API PLAIN __attribute__((visibility("default")))
#endif

enum { STATES = FIRST + ORDER, INPUTS = HEAT + HEATED };

static double linear_rise(const double *poles, int part) {
  double z = 0;
  for (int k = 0; k < ORDER; k++) z += READ[part][k] * poles[k];
  return z;
}

static double rise(const double *poles, int part) {
  double z = linear_rise(poles, part);
  return z + COEFFICIENT * z * z;
}

/* What the heat from outside adds to dx_k/dt */
static double warming(const double *in, int k) {
  double sum = 0;
  for (int i = 0; i < HEATED; i++) sum += GAIN[k][i] * in[HEAT + i];
  return sum;
}
