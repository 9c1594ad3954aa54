// One Rosenbrock step of light, carriers and a Foster network; coupled/kernels/rosenbrock.py.
//
// With s = 1/(gamma h), heat eliminated from (s - J) u = r leaves a 3 x 3 system, whatever the number of poles:
//   (s - J_o - gamma G c w^T) u_o = r_o + c (sum of the poles' own stages),   G = sum_i h gain_i/(1 + gamma h rate_i)
// c is the derivative of light and carriers by z = sum_i x_i, w that of the absorbed power by light and carriers.

import { linearise } from "./equations.mjs";
import { dispersionNear } from "./ring.mjs";
import { finish, polesOf, polynomialsOf, prepare, stageOf } from "./poles.mjs";

/** A tableau of coupled/kernels/tableaus.json as flat arrays, with gamma_qj (sums) and beta = alpha + gamma of its poles. */
export function methodOf(table) {
  const n = table.a.length;
  const flat = (rows) => Float64Array.from(rows.flat());
  const [a, c] = [flat(table.a), flat(table.c)];
  const sums = new Float64Array(n * n); // the inverse of 1/gamma - c, column by column
  const beta = new Float64Array(n * n);
  for (let j = 0; j < n; j++) {
    sums[j * n + j] = table.gamma;
    for (let q = j + 1; q < n; q++) {
      for (let i = j; i < q; i++) sums[q * n + j] += table.gamma * c[q * n + i] * sums[i * n + j];
    }
  }
  for (let q = 0; q < n; q++) {
    for (let j = 0; j <= q; j++) {
      beta[q * n + j] = sums[q * n + j];
      for (let i = j; i < q; i++) beta[q * n + j] += a[q * n + i] * sums[i * n + j];
    }
  }
  const method = { order: table.order, gamma: table.gamma, stages: n, a, c, d: flat(table.dense), sums, beta };
  return { ...method, polynomials: polynomialsOf(method) };
}

/**
 * What a step works in: the numbers of one system under a constant laser, and room for its stages. `step` fills u
 * (stages x 4: light, carriers and the sum over the poles) and ends (z before and after, and the error of heat).
 */
export function machineOf(system, drive, detuning, method) {
  const s = system;
  return {
    p: Float64Array.of(s.loss, s.absorbed, s.fca, s.tpa, s.g, s.tau0, s.a, s.b, s.shift, s.kerr, s.curvature, drive, detuning, method.gamma),
    m: s.gain.length + 3, method, system, detuning, poles: polesOf(s, method),
    u: new Float64Array(4 * method.stages),
    ends: new Float64Array(3),
    L: new Float64Array(17),
    near: new Float64Array(2 + s.fcd.length / 2),
  }; // prettier-ignore
}

/** Take one step of h ns from y to out. */
export function step(machine, y, h, out) {
  const { p, method, system, poles, u, ends, L, near } = machine;
  const { stages, a, c } = method;
  const loss = p[0], absorbed = p[1], fca = p[2], tpa = p[3], g = p[4], tau0 = p[5], sa = p[6], sb = p[7]; // prettier-ignore
  const ts = p[8], kerr = p[9], curvature = p[10], drive = p[11], detuning = p[12], gamma = p[13]; // prettier-ignore
  const end = 4 * (stages - 1);
  const s = 1 / (gamma * h);
  const perH = 1 / h;
  const gammaH = gamma * h;
  const G = gamma * prepare(poles, y, h);
  linearise(system, detuning, y, L, near);
  const y0 = y[0];
  const y1 = y[1];
  const y2 = y[2];
  const start = L[14];
  const u0 = L[9];
  const u1 = L[10];
  const w0 = L[11];
  const w1 = L[12];
  const w2 = L[13];
  const m00 = s - L[0] - G * u0 * w0;
  const m01 = -L[1] - G * u0 * w1;
  const m02 = -L[2] - G * u0 * w2;
  const m10 = -L[3] - G * u1 * w0;
  const m11 = s - L[4] - G * u1 * w1;
  const m12 = -L[5] - G * u1 * w2;
  const m20 = -L[6];
  const m21 = -L[7];
  const m22 = s - L[8];
  const c0 = m11 * m22 - m12 * m21;
  const c1 = m12 * m20 - m10 * m22;
  const c2 = m10 * m21 - m11 * m20;
  const det = 1 / (m00 * c0 + m01 * c1 + m02 * c2);
  const i00 = det * c0;
  const i01 = det * (m02 * m21 - m01 * m22);
  const i02 = det * (m01 * m12 - m02 * m11);
  const i10 = det * c1;
  const i11 = det * (m00 * m22 - m02 * m20);
  const i12 = det * (m02 * m10 - m00 * m12);
  const i20 = det * c2;
  const i21 = det * (m01 * m20 - m00 * m21);
  const i22 = det * (m00 * m11 - m01 * m10);
  let ar = y0;
  let ai = y1;
  let N = y2;
  let z = start;
  let U = y0 * y0 + y1 * y1;
  let D = L[15];
  let damping = L[16];
  for (let q = 0; q < stages; q++) {
    let r0 = 0;
    let r1 = 0;
    let r2 = 0;
    let left = 0;
    if (q > 0) {
      ar = y0;
      ai = y1;
      N = y2;
      z = start;
      const row = q * stages;
      for (let j = 0, at = 0; j < q; j++, at += 4) {
        const x = a[row + j];
        const f = c[row + j];
        const v0 = u[at];
        const v1 = u[at + 1];
        const v2 = u[at + 2];
        const v3 = u[at + 3];
        ar += x * v0;
        ai += x * v1;
        N += x * v2;
        z += x * v3;
        r0 += f * v0;
        r1 += f * v1;
        r2 += f * v2;
        left += f * v3;
      }
      r0 *= perH;
      r1 *= perH;
      r2 *= perH;
      left *= perH;
      U = ar * ar + ai * ai;
      D = -ts * (z + curvature * z * z) - dispersionNear(N, system, near) - kerr * U - detuning;
      damping = loss + fca * N + tpa * U;
    }
    const heat = 2 * (absorbed + fca * N + tpa * U) * U;
    const back = gammaH * left + gamma * stageOf(poles, q) + heat * G;
    r0 += -damping * ar - D * ai + u0 * back;
    r1 += -damping * ai + D * ar + drive + u1 * back;
    r2 += g * U * U - (N * (1 + sb * N)) / (tau0 * (1 + sa * N));
    const k0 = i00 * r0 + i01 * r1 + i02 * r2;
    const k1 = i10 * r0 + i11 * r1 + i12 * r2;
    const k2 = i20 * r0 + i21 * r1 + i22 * r2;
    const feedback = w0 * k0 + w1 * k1 + w2 * k2;
    poles.push[q] = heat + feedback;
    const at = 4 * q;
    u[at] = k0;
    u[at + 1] = k1;
    u[at + 2] = k2;
    u[at + 3] = back + feedback * G;
  }
  out[0] = ar + u[end];
  out[1] = ai + u[end + 1];
  out[2] = N + u[end + 2];
  ends[0] = start;
  ends[1] = z + u[end + 3];
  ends[2] = finish(poles, y, out);
}
