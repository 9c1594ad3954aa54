// dy/dt of ring and Foster network, and its derivative; coupled/kernels/equations.py.
//
// State y = [Re a, Im a, N, x_1 .. x_n]; dT = z + curvature z^2, z = sum_i x_i.

import { absorbedPower, dispersion } from "./ring.mjs";

/** From nothing: no light, no carriers, no heat. */
export function cold(system) {
  return new Float64Array(3 + system.gain.length);
}

/** d(dy/dt)/dy at a state, row-major. */
export function jacobian(system, detuning, y) {
  const n = y.length;
  const J = new Float64Array(n * n);
  const { loss, absorbed, fca, tpa, g, tau0, a: sa, b: sb, shift: ts, kerr, fcd, gain, rate, curvature } = system;
  const S = new Float64Array(2);
  const [ar, ai, N] = y;
  dispersion(N, fcd, S);
  let z = 0;
  for (let i = 3; i < n; i++) z += y[i];
  const dT = z + curvature * z * z;
  const lift = 1 + 2 * curvature * z;
  const U = ar * ar + ai * ai;
  const D = -ts * dT - S[0] - kerr * U - detuning;
  const damping = loss + fca * N + tpa * U;
  const saturation = 1 + sa * N;
  const cross = 2 * tpa * ar * ai;
  const turn = 2 * kerr * ar * ai;
  const byU = 2 * (absorbed + fca * N + 2 * tpa * U);
  J[0] = -damping - 2 * tpa * ar * ar + turn;
  J[1] = -D - cross + 2 * kerr * ai * ai;
  J[2] = -fca * ar + S[1] * ai;
  J[n] = D - cross - 2 * kerr * ar * ar;
  J[n + 1] = -damping - 2 * tpa * ai * ai - turn;
  J[n + 2] = -fca * ai - S[1] * ar;
  J[2 * n] = 4 * g * U * ar;
  J[2 * n + 1] = 4 * g * U * ai;
  J[2 * n + 2] = -(1 + sb * N * (2 + sa * N)) / (tau0 * saturation * saturation);
  for (let i = 3; i < n; i++) {
    J[i] = ts * ai * lift;
    J[n + i] = -ts * ar * lift;
    J[i * n] = gain[i - 3] * 2 * byU * ar;
    J[i * n + 1] = gain[i - 3] * 2 * byU * ai;
    J[i * n + 2] = gain[i - 3] * 2 * fca * U;
    J[i * n + i] = -rate[i - 3];
  }
  return J;
}

/** dy/dt at a state. */
export function flow(system, drive, detuning, y, out) {
  const { loss, fca, tpa, g, tau0, a, b, shift, kerr, fcd, gain, rate, curvature } = system;
  const S = new Float64Array(2);
  const [ar, ai, N] = y;
  dispersion(N, fcd, S);
  let z = 0;
  for (let i = 3; i < y.length; i++) z += y[i];
  const U = ar * ar + ai * ai;
  const D = -shift * (z + curvature * z * z) - S[0] - kerr * U - detuning;
  const damping = loss + fca * N + tpa * U;
  const heat = absorbedPower(U, N, system);
  out[0] = -damping * ar - D * ai;
  out[1] = -damping * ai + D * ar + drive;
  out[2] = g * U * U - (N * (1 + b * N)) / (tau0 * (1 + a * N));
  for (let i = 3; i < y.length; i++) out[i] = gain[i - 3] * heat - rate[i - 3] * y[i];
  return out;
}
