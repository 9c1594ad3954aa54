// dy/dt of ring and Foster network, and its derivative; coupled/kernels/equations.py.
//
// State y = [Re a, Im a, N, x_1 .. x_n]; dT = z + curvature z^2, z = sum_i x_i.

import { absorbedPower, dispersion, dispersionShift } from "./ring.mjs";

/** From nothing: no light, no carriers, no heat. */
export function cold(system) {
  return new Float64Array(3 + system.gain.length);
}

/**
 * The derivative at a state, written to L: light and carriers by themselves, row-major in 0 .. 8, field by z in 9 and 10,
 * absorbed power by light and carriers in 11 .. 13; then z, D and the damping in 14 .. 16.
 */
export function linearise(system, detuning, y, L, near = null) {
  const { loss, absorbed, fca, tpa, g, tau0, a: sa, b: sb, shift: ts, kerr, fcd, curvature } = system;
  const ar = y[0];
  const ai = y[1];
  const N = y[2];
  let z = 0;
  for (let i = 3; i < y.length; i++) z += y[i];
  dispersion(N, fcd, L, near);
  const S = L[0];
  const byN = L[1];
  const lift = 1 + 2 * curvature * z;
  const U = ar * ar + ai * ai;
  const D = -ts * (z + curvature * z * z) - S - kerr * U - detuning;
  const damping = loss + fca * N + tpa * U;
  const saturation = 1 + sa * N;
  const cross = 2 * tpa * ar * ai;
  const turn = 2 * kerr * ar * ai;
  const byU = 2 * (absorbed + fca * N + 2 * tpa * U);
  L[0] = -damping - 2 * tpa * ar * ar + turn;
  L[1] = -D - cross + 2 * kerr * ai * ai;
  L[2] = -fca * ar + byN * ai;
  L[3] = D - cross - 2 * kerr * ar * ar;
  L[4] = -damping - 2 * tpa * ai * ai - turn;
  L[5] = -fca * ai - byN * ar;
  L[6] = 4 * g * U * ar;
  L[7] = 4 * g * U * ai;
  L[8] = -(1 + sb * N * (2 + sa * N)) / (tau0 * saturation * saturation);
  L[9] = ts * ai * lift;
  L[10] = -ts * ar * lift;
  L[11] = 2 * byU * ar;
  L[12] = 2 * byU * ai;
  L[13] = 2 * fca * U;
  L[14] = z;
  L[15] = D;
  L[16] = damping;
}

/** d(dy/dt)/dy at a state, row-major. */
export function jacobian(system, detuning, y) {
  const n = y.length;
  const J = new Float64Array(n * n);
  const L = new Float64Array(17);
  const { gain, rate } = system;
  linearise(system, detuning, y, L);
  for (let k = 0; k < 3; k++) J.set(L.subarray(3 * k, 3 * k + 3), k * n);
  for (let i = 3; i < n; i++) {
    J[i] = L[9];
    J[n + i] = L[10];
    for (let k = 0; k < 3; k++) J[i * n + k] = gain[i - 3] * L[11 + k];
    J[i * n + i] = -rate[i - 3];
  }
  return J;
}

/** dy/dt at a state. */
export function flow(system, drive, detuning, y, out) {
  const { loss, fca, tpa, g, tau0, a, b, shift, kerr, fcd, gain, rate, curvature } = system;
  const [ar, ai, N] = y;
  let z = 0;
  for (let i = 3; i < y.length; i++) z += y[i];
  const U = ar * ar + ai * ai;
  const D = -shift * (z + curvature * z * z) - dispersionShift(N, fcd) - kerr * U - detuning;
  const damping = loss + fca * N + tpa * U;
  const heat = absorbedPower(U, N, system);
  out[0] = -damping * ar - D * ai;
  out[1] = -damping * ai + D * ar + drive;
  out[2] = g * U * U - (N * (1 + b * N)) / (tau0 * (1 + a * N));
  for (let i = 3; i < y.length; i++) out[i] = gain[i - 3] * heat - rate[i - 3] * y[i];
  return out;
}
