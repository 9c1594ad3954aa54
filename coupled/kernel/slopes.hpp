// dy/dt of rings under their light, and its derivative J (size x size), from the blocks of a step.
#pragma once
#include "step.hpp"

template <int F>
void slopes(const Problem& p, const Light& light, const double* y, double* dy, double* J) {
  constexpr int B = 2 * F + 1;
  const int R = p.rings, K = p.order, size = R * (B + K);
  memset(J, 0, size * size * sizeof(double));
  for (int i = 0; i < R; i++) {
    const int heat = R * B + i * K;
    const double* x = y + heat;
    double z = 0, rise = 0;
    auto read = [&](int k) { return p.heat == QUADRATIC ? p.C[k] : p.read ? p.read[i * K + k] : 1; };
    for (int k = 0; k < K; k++) z += read(k) * x[k];
    const double* cross = p.cross ? p.cross + i * R * K : nullptr;
    for (int k = 0; k < R * K && cross; k++) rise += cross[k] * y[R * B + k];
    Block<F, double> block;
    block.linearize(ring_of<F>(p, i), y + i * B, z, rise, light.detuning + i * F);
    for (int m = 0; m < B; m++) {
      double* row = J + (i * B + m) * size;
      const int other = m % 2 ? -1 : 1;  // i s: -Im s in Re a, Re s in Im a
      dy[i * B + m] = block.f[m] - (m < 2 * F ? other * light.in[2 * F * i + m + other] : 0);
      for (int l = 0; l < B; l++) row[i * B + l] = -block.matrix[m][l];
      for (int k = 0; k < K; k++) row[heat + k] = block.u[m] * read(k);
      for (int k = 0; k < R * K && cross; k++)
        row[R * B + k] += block.u[m] / (1 + 2 * p.bend[i] * z) * cross[k];
    }
    for (int k = 0; k < K; k++) {
      double *row = J + (heat + k) * size, gain;
      if (p.heat == QUADRATIC) {
        dy[heat + k] = quadratic(p, k, x, block.P), gain = p.B[k];
        for (int j = 0; j < K; j++) {
          const double* H = p.H + (k * K + j) * K;
          gain += p.G[k * K + j] * x[j], row[heat + j] = p.A[k * K + j] + p.G[k * K + j] * block.P;
          for (int l = 0; l < K; l++) row[heat + j] += 2 * H[l] * x[l];
        }
      } else {
        gain = p.gain[i * K + k], row[heat + k] = -p.rate[i * K + k];
        dy[heat + k] = gain * block.P - p.rate[i * K + k] * x[k];
      }
      for (int l = 0; l < B; l++) row[i * B + l] = gain * block.w[l];
    }
  }
  for (int m = 0; m < R && p.light != SINGLE; m++)
    for (int l = 0; l < R; l++) {  // light of other rings: M_ij a_j
      const int i = p.sequence[m], j = p.sequence[l];
      double M[2] = {0, 0};
      if (p.light == LOOPS && i != j) memcpy(M, p.between + 2 * (i * R + j), sizeof M);
      if (p.light == BUS && l < m) add_product(M, p.taken + 2 * i, p.sent + 2 * j);
      add_product(dy + i * B, M, y + j * B);
      double *re = J + i * B * size + j * B, *im = re + size;
      re[0] += M[0], re[1] -= M[1], im[0] += M[1], im[1] += M[0];
    }
}
