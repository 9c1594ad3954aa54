// Error-controlled Rosenbrock integration of light, carriers and a Foster network; coupled/kernels/rosenbrock.py.
//
// With s = 1/(gamma h), heat eliminated from (s - J) k = r leaves a 3 x 3 system, whatever the number of poles:
//   k_i = (r_i + gain_i w.k_o)/(s + rate_i),   (s - J_o - G u w^T) k_o = r_o + u sum_i r_i/(s + rate_i)
// State y = [Re a, Im a, N, x_1 .. x_n]; dT = z + curvature z^2, z = sum_i x_i.

import { absorbedPower, dispersion, floorOf } from "./ring.mjs";
import { eigenvalues } from "./eigen.mjs";

export const DONE = 0;
export const TOO_MANY_STEPS = 1;
export const STEP_TOO_SMALL = 2;
export const EVENT = 3;
const QUIET = 1e-2;

/** A tableau of coupled/kernels/tableaus.json as flat arrays. */
export function methodOf(table) {
  const flat = (rows) => Float64Array.from(rows.flat());
  return { order: table.order, gamma: table.gamma, stages: table.a.length, a: flat(table.a), c: flat(table.c), d: flat(table.dense) };
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

/**
 * What a step works in: the numbers of one system under a constant laser, and room for its stages.
 * `step` fills k (stages x (3 + n)), total (the sum of each stage over the poles) and ends (z before and after).
 */
export function machineOf(system, drive, detuning, method) {
  const n = system.gain.length;
  const { stages, a, c, d, gamma } = method;
  const s = system;
  return {
    p: Float64Array.of(s.loss, s.absorbed, s.fca, s.tpa, s.g, s.tau0, s.a, s.b, s.shift, s.kerr, s.curvature, drive, detuning, gamma),
    n, m: n + 3, stages, a, c, d,
    fcd: s.fcd, gain: s.gain, rate: s.rate,
    k: new Float64Array(stages * (n + 3)),
    total: new Float64Array(stages),
    ends: new Float64Array(2),
    damp: new Float64Array(n),
    share: new Float64Array(n), // gain_i/(s + rate_i)
    S: new Float64Array(2),
    sum: new Float64Array(1),
  }; // prettier-ignore
}

/** Take one step of h ns from y to out. */
export function step(machine, y, h, out) {
  const { p, n, m, stages, a, c, fcd, gain, rate, k, total, ends, damp, share, S, sum } = machine;
  const loss = p[0], absorbed = p[1], fca = p[2], tpa = p[3], g = p[4], tau0 = p[5], sa = p[6], sb = p[7]; // prettier-ignore
  const ts = p[8], kerr = p[9], curvature = p[10], drive = p[11], detuning = p[12], gamma = p[13]; // prettier-ignore
  const last = stages - 1;
  const s = 1 / (gamma * h);
  const perH = 1 / h;
  let start = 0;
  let G = 0;
  for (let i = 0; i < n; i++) {
    start += y[3 + i];
    const d = 1 / (s + rate[i]);
    damp[i] = d;
    share[i] = gain[i] * d;
    G += share[i];
  }
  const y0 = y[0];
  const y1 = y[1];
  const y2 = y[2];
  dispersion(y2, fcd, S);
  let dT = start + curvature * start * start;
  const lift = 1 + 2 * curvature * start;
  let U = y0 * y0 + y1 * y1;
  let D = -ts * dT - S[0] - kerr * U - detuning;
  let damping = loss + fca * y2 + tpa * U;
  const saturation = 1 + sa * y2;
  const cross = 2 * tpa * y0 * y1;
  const turn = 2 * kerr * y0 * y1;
  const byU = 2 * (absorbed + fca * y2 + 2 * tpa * U);
  const u0 = ts * y1 * lift;
  const u1 = -ts * y0 * lift;
  const w0 = 2 * byU * y0;
  const w1 = 2 * byU * y1;
  const w2 = 2 * fca * U;
  const m00 = s + damping + 2 * tpa * y0 * y0 - turn - G * u0 * w0;
  const m01 = D + cross - 2 * kerr * y1 * y1 - G * u0 * w1;
  const m02 = fca * y0 - S[1] * y1 - G * u0 * w2;
  const m10 = -D + cross + 2 * kerr * y0 * y0 - G * u1 * w0;
  const m11 = s + damping + 2 * tpa * y1 * y1 + turn - G * u1 * w1;
  const m12 = fca * y1 + S[1] * y0 - G * u1 * w2;
  const m20 = -4 * g * U * y0;
  const m21 = -4 * g * U * y1;
  const m22 = s + (1 + sb * y2 * (2 + sa * y2)) / (tau0 * saturation * saturation);
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
  for (let q = 0; q < stages; q++) {
    let r0 = 0;
    let r1 = 0;
    let r2 = 0;
    const at = q * m;
    if (q > 0) {
      ar = y0;
      ai = y1;
      N = y2;
      z = start;
      for (let j = 0; j < q; j++) {
        const x = a[q * stages + j];
        const f = c[q * stages + j] * perH;
        const kj = j * m;
        ar += x * k[kj];
        ai += x * k[kj + 1];
        N += x * k[kj + 2];
        z += x * total[j];
        r0 += f * k[kj];
        r1 += f * k[kj + 1];
        r2 += f * k[kj + 2];
      }
      dT = z + curvature * z * z;
      dispersion(N, fcd, S);
      U = ar * ar + ai * ai;
      D = -ts * dT - S[0] - kerr * U - detuning;
      damping = loss + fca * N + tpa * U;
    }
    const heat = 2 * (absorbed + fca * N + tpa * U) * U;
    heatStage(machine, q, y, perH, out);
    const back = sum[0] + heat * G;
    r0 += -damping * ar - D * ai + u0 * back;
    r1 += -damping * ai + D * ar + drive + u1 * back;
    r2 += g * U * U - (N * (1 + sb * N)) / (tau0 * (1 + sa * N));
    const k0 = i00 * r0 + i01 * r1 + i02 * r2;
    const k1 = i10 * r0 + i11 * r1 + i12 * r2;
    const k2 = i20 * r0 + i21 * r1 + i22 * r2;
    const feedback = w0 * k0 + w1 * k1 + w2 * k2;
    const push = heat + feedback;
    for (let i = 0; i < n; i++) k[at + 3 + i] += push * share[i];
    k[at] = k0;
    k[at + 1] = k1;
    k[at + 2] = k2;
    total[q] = back + feedback * G;
  }
  const end = last * m;
  out[0] = ar + k[end];
  out[1] = ai + k[end + 1];
  out[2] = N + k[end + 2];
  for (let i = 0; i < n; i++) out[3 + i] += k[end + 3 + i]; // the states of the last stage, which stands on all others
  ends[0] = start;
  ends[1] = z + total[last];
}

/**
 * What the poles do on their own in stage q, times their damping, and the sum of it; the last stage also writes its
 * states, from which the new ones follow. Each stage has a loop of its own: this is most of the work of a step.
 */
function heatStage(machine, q, y, perH, out) {
  const { n, m, stages, a, c, rate, k, damp } = machine;
  let sum = 0;
  const row = q * stages;
  const e = q * m + 3;
  const a0 = a[row], a1 = a[row + 1], a2 = a[row + 2], a3 = a[row + 3], a4 = a[row + 4]; // prettier-ignore
  const f0 = c[row] * perH, f1 = c[row + 1] * perH, f2 = c[row + 2] * perH, f3 = c[row + 3] * perH, f4 = c[row + 4] * perH; // prettier-ignore
  const o1 = m + 3, o2 = 2 * m + 3, o3 = 3 * m + 3, o4 = 4 * m + 3; // prettier-ignore
  if (q === 0) {
    for (let i = 0; i < n; i++) {
      const v = -rate[i] * y[3 + i] * damp[i];
      k[e + i] = v;
      sum += v;
    }
  } else if (q === 1) {
    for (let i = 0; i < n; i++) {
      const k0 = k[3 + i];
      const v = (f0 * k0 - rate[i] * (y[3 + i] + a0 * k0)) * damp[i];
      k[e + i] = v;
      sum += v;
    }
  } else if (q === 2) {
    for (let i = 0; i < n; i++) {
      const k0 = k[3 + i], k1 = k[o1 + i]; // prettier-ignore
      const v = (f0 * k0 + f1 * k1 - rate[i] * (y[3 + i] + a0 * k0 + a1 * k1)) * damp[i];
      k[e + i] = v;
      sum += v;
    }
  } else if (q === 3) {
    for (let i = 0; i < n; i++) {
      const k0 = k[3 + i], k1 = k[o1 + i], k2 = k[o2 + i]; // prettier-ignore
      const v = (f0 * k0 + f1 * k1 + f2 * k2 - rate[i] * (y[3 + i] + a0 * k0 + a1 * k1 + a2 * k2)) * damp[i];
      k[e + i] = v;
      sum += v;
    }
  } else if (q === 4) {
    for (let i = 0; i < n; i++) {
      const k0 = k[3 + i], k1 = k[o1 + i], k2 = k[o2 + i], k3 = k[o3 + i]; // prettier-ignore
      const state = y[3 + i] + a0 * k0 + a1 * k1 + a2 * k2 + a3 * k3;
      const v = (f0 * k0 + f1 * k1 + f2 * k2 + f3 * k3 - rate[i] * state) * damp[i];
      k[e + i] = v;
      sum += v;
    }
  } else {
    for (let i = 0; i < n; i++) {
      const k0 = k[3 + i], k1 = k[o1 + i], k2 = k[o2 + i], k3 = k[o3 + i], k4 = k[o4 + i]; // prettier-ignore
      let state = y[3 + i] + a0 * k0 + a1 * k1 + a2 * k2 + a3 * k3 + a4 * k4;
      let v = f0 * k0 + f1 * k1 + f2 * k2 + f3 * k3 + f4 * k4;
      for (let j = 5; j < q; j++) {
        state += a[row + j] * k[j * m + 3 + i];
        v += c[row + j] * perH * k[j * m + 3 + i];
      }
      v = (v - rate[i] * state) * damp[i];
      out[3 + i] = state;
      k[e + i] = v;
      sum += v;
    }
  }
  machine.sum[0] = sum;
}

/** One component of the dense output at the fraction x of a step; entry `at` of every stage of `k`. */
function dense(x, before, after, k, at, stride, method) {
  const { d, stages } = method;
  let d1 = 0;
  let d2 = 0;
  let d3 = 0;
  for (let j = 0; j < stages; j++) {
    const value = k[at + j * stride];
    d1 += d[j] * value;
    d2 += d[stages + j] * value;
    d3 += d[2 * stages + j] * value;
  }
  return (1 - x) * before + x * (after + (1 - x) * (d1 + x * (d2 + x * d3)));
}

function fastestGrowth(system, detuning, y) {
  const { re, im } = eigenvalues(jacobian(system, detuning, y), y.length);
  let fastest = 0;
  for (let i = 0; i < re.length; i++) if (re[i] > 0) fastest = Math.max(fastest, Math.hypot(re[i], im[i]));
  return fastest;
}

/**
 * Integrate from y at t = 0 to `stop` ns under a constant laser.
 *
 * options: method, rtol, first (step to try first), event { level, stop } (N rises through level), times (wanted output
 * times, ns), steps (whether to keep the steps taken), maxSteps.
 * Returns rows (t, Re a, Im a, N, dT for each accepted step or wanted time), count, y, t, h, crossings, counts, ended.
 */
export function integrate(system, drive, detuning, start, stop, options) {
  const { method, rtol, first = 0, event = null, times = null, steps = null, maxSteps = 400000 } = options;
  const machine = machineOf(system, drive, detuning, method);
  const { k, total, ends, m } = machine;
  const floor = floorOf(system, drive);
  const { curvature } = system;
  const lastStage = (method.stages - 1) * m;
  let y = Float64Array.from(start);
  let out = new Float64Array(m);
  let rows = new Float64Array(5 * (times ? times.length : 4096));
  let count = 0;
  const crossings = [];
  let t = 0;
  let accepted = 0;
  let rejected = 0;
  let z = 0;
  for (let i = 3; i < m; i++) z += y[i];
  const record = (time, ar, ai, N, heat) => {
    if (5 * (count + 1) > rows.length) {
      const wider = new Float64Array(2 * rows.length);
      wider.set(rows);
      rows = wider;
    }
    const at = 5 * count++;
    rows[at] = time;
    rows[at + 1] = ar;
    rows[at + 2] = ai;
    rows[at + 3] = N;
    rows[at + 4] = heat + curvature * heat * heat;
  };
  const between = (time, x) =>
    record(
      time,
      dense(x, y[0], out[0], k, 0, m, method),
      dense(x, y[1], out[1], k, 1, m, method),
      dense(x, y[2], out[2], k, 2, m, method),
      dense(x, ends[0], ends[1], total, 0, 1, method),
    );
  if (!times) record(0, y[0], y[1], y[2], z);
  else while (count < times.length && times[count] <= 0) record(times[count], y[0], y[1], y[2], z);
  let seen = event && !event.leaving ? y[2] - event.level : 1;
  let h = first > 0 ? first : 1e-2 / system.loss;
  let hBefore = 0;
  let sizeBefore = 1;
  let growth = 5;
  const quiet = 0.1 * system.tau0;
  let lookAgain = 0;
  let looked = 0;
  let cap = Infinity;
  let ended = DONE;
  while (t < stop) {
    if (accepted + rejected >= maxSteps) {
      ended = TOO_MANY_STEPS;
      break;
    }
    const landing = t + 1.0001 * h >= stop;
    if (landing) h = stop - t;
    step(machine, y, h, out);
    let heat = 0;
    for (let i = 3; i < m; i++) heat += Math.abs(k[lastStage + i]);
    const energy = Math.max(y[0] * y[0] + y[1] * y[1], out[0] * out[0] + out[1] * out[1], floor[0] * floor[0]);
    const e0 = (k[lastStage] * k[lastStage] + k[lastStage + 1] * k[lastStage + 1]) / energy;
    const e1 = k[lastStage + 2] / Math.max(Math.abs(y[2]), Math.abs(out[2]), floor[1]);
    const e2 = heat / Math.max(Math.abs(ends[0]), Math.abs(ends[1]), floor[2]);
    const error = Math.sqrt((e0 + e1 * e1 + e2 * e2) / 3) / rtol;
    const size = Math.max(error, 1e-8) ** (1 / method.order);
    if (!(error <= 1)) {
      rejected++;
      growth = 1;
      h *= error < Infinity ? Math.max(0.2, 0.9 / size) : 0.2;
      if (h < 1e-13 * Math.max(Math.abs(t), 1e-3)) {
        ended = STEP_TOO_SMALL;
        break;
      }
      continue;
    }
    if (event) {
      const rest = out[2] - event.level;
      if (seen < 0 && rest >= 0) {
        let low = 0;
        let high = 1;
        for (let i = 0; i < 52; i++) {
          const x = 0.5 * (low + high);
          if (dense(x, y[2], out[2], k, 2, m, method) < event.level) low = x;
          else high = x;
        }
        crossings.push(t + high * h);
        if (event.stop) {
          if (!times) between(t + high * h, high);
          const at = new Float64Array(m);
          for (let i = 0; i < m; i++) at[i] = dense(high, y[i], out[i], k, i, m, method);
          return { rows, count, y: at, t: t + high * h, h, crossings, accepted: accepted + 1, rejected, ended: EVENT };
        }
      }
      seen = rest;
    }
    if (times) {
      const whole = landing;
      while (count < times.length && (whole || times[count] <= t + h)) between(times[count], (times[count] - t) / h);
    }
    accepted++;
    if (steps) steps.push(h);
    t = landing ? stop : t + h;
    [y, out] = [out, y];
    if (!times) record(t, y[0], y[1], y[2], ends[1]);
    let factor = 0.9 / size;
    if (hBefore > 0) factor = Math.min(factor, ((factor * h) / hBefore) * (sizeBefore / size));
    hBefore = h;
    sizeBefore = Math.max(size, 0.3);
    h *= Math.max(0.2, Math.min(growth, factor));
    growth = 5;
    if (h > quiet) {
      const d0 = Math.hypot(y[0] - out[0], y[1] - out[1]) / Math.max(Math.hypot(y[0], y[1]), floor[0]);
      const d1 = Math.abs(y[2] - out[2]) / Math.max(Math.abs(y[2]), floor[1]);
      const d2 = Math.abs(ends[1] - ends[0]) / Math.max(Math.abs(ends[1]), floor[2]);
      if (Math.max(d0, d1, d2) > QUIET) {
        looked = 0;
        cap = Infinity;
      } else if (h > 4 * looked || accepted >= lookAgain) {
        looked = h;
        lookAgain = accepted + 20;
        const fastest = fastestGrowth(system, detuning, y);
        cap = fastest > 0 ? 0.25 / fastest : Infinity;
      }
      h = Math.min(h, cap);
    }
  }
  return { rows, count, y, t, h, crossings, accepted, rejected, ended };
}

/** The state after the given steps: the same map for every start, so that differences of it are smooth. */
export function replay(system, drive, detuning, start, steps, method) {
  const machine = machineOf(system, drive, detuning, method);
  let y = Float64Array.from(start);
  let out = new Float64Array(machine.m);
  for (const h of steps) {
    step(machine, y, h, out);
    [y, out] = [out, y];
  }
  return y;
}

/** From nothing: no light, no carriers, no heat. */
export function cold(system) {
  return new Float64Array(3 + system.gain.length);
}
