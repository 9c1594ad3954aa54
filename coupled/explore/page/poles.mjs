// The poles of heat within one Rosenbrock step: all that is done for each of them.
//
// They are linear, so that with kappa_q = h k_q the matrices a and c of the method act as one, beta = alpha + gamma:
//   kappa_q = o (x + sum_{j<q} beta_qj kappa_j) + s push_q,   o = -h rate/(1 + gamma h rate),   s = h gain/(1 + gamma h rate)
// push_q = absorbed power at the stage + w.u_q is one number for all poles. So kappa_q = x A_q(o) + s sum_j push_j B_qj(o)
// with polynomials that belong to the method alone, and sums over the poles follow from the moments sum x o^k, sum s o^k.
// Their terms are at most 121 times their values (-1/gamma < o <= 0). The new state is x + sum_q beta_lq kappa_q with the
// last stage l, the error estimate sum_q gamma_lq kappa_q.

const FEWEST = 6; // stages, whose moments have a variable each

/** The polynomials of a method as rows of coefficients of o^0, o^1, ..: A_q; B_qj; and those of new state and error. */
export function polynomialsOf({ stages: n, beta, sums }) {
  const width = n + 1;
  const own = new Float64Array(n * width);
  const pushed = new Float64Array(n * n * width); // row q n + j
  for (let q = 0; q < n; q++) {
    own[q * width + 1] = 1;
    pushed[(q * n + q) * width] = 1;
    for (let j = 0; j < q; j++) {
      for (let k = 1; k < width; k++) own[q * width + k] += beta[q * n + j] * own[j * width + k - 1];
      for (let m = j; m < q; m++) {
        for (let k = 1; k < width; k++) pushed[(q * n + j) * width + k] += beta[q * n + m] * pushed[(m * n + j) * width + k - 1];
      }
    }
  }
  const mixed = (weights, constant) => {
    const by = (q) => weights[(n - 1) * n + q];
    const x = new Float64Array(width);
    const s = new Float64Array(n * n); // row k: what every push adds to the coefficient of o^k
    x[0] = constant;
    for (let q = 0; q < n; q++) {
      for (let k = 0; k < width; k++) x[k] += by(q) * own[q * width + k];
      for (let j = 0; j <= q; j++) for (let k = 0; k < n; k++) s[k * n + j] += by(q) * pushed[(q * n + j) * width + k];
    }
    return { x, s };
  };
  return { own, pushed, after: mixed(beta, 1), error: mixed(sums, 0) };
}

/** Room for the poles of one system under one method. */
export function polesOf({ gain, rate }, { stages, gamma, beta, sums, polynomials }) {
  const n = rate.length;
  const room = (size) => new Float64Array(size);
  return {
    n, gain, rate, stages, gamma, beta, sums, polynomials, factor: room(n), share: room(n), push: room(stages),
    byState: room(stages + 1), byShare: room(stages + 1), q: room(stages + 1), f: room(stages + 1),
  }; // prettier-ignore
}

/** Prepare a step of h ns from y; returns sum_i s_i. */
export function prepare({ n, gain, rate, stages, gamma, factor, share, byState, byShare }, y, h) {
  const gh = gamma * h;
  let x1 = 0, x2 = 0, x3 = 0, x4 = 0, x5 = 0, x6 = 0; // prettier-ignore
  let s0 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0, s5 = 0; // prettier-ignore
  for (let k = FEWEST; k <= stages; k++) byState[k] = byShare[k] = 0;
  for (let i = 0; i < n; i++) {
    const r = rate[i];
    const d = h / (1 + gh * r);
    const o = -r * d;
    let s = gain[i] * d;
    factor[i] = o;
    share[i] = s;
    let x = o * y[3 + i];
    x1 += x;
    x2 += x *= o;
    x3 += x *= o;
    x4 += x *= o;
    x5 += x *= o;
    x6 += x *= o;
    s0 += s;
    s1 += s *= o;
    s2 += s *= o;
    s3 += s *= o;
    s4 += s *= o;
    s5 += s *= o;
    for (let k = FEWEST; k < stages; k++) {
      byState[k + 1] += x *= o;
      byShare[k] += s *= o;
    }
  }
  byState[1] = x1;
  byState[2] = x2;
  byState[3] = x3;
  byState[4] = x4;
  byState[5] = x5;
  byState[6] = x6;
  byShare[0] = s0;
  byShare[1] = s1;
  byShare[2] = s2;
  byShare[3] = s3;
  byShare[4] = s4;
  byShare[5] = s5;
  return s0;
}

/** The sum of kappa_q over the poles, without its own push; `push` holds those of the stages before. */
export function stageOf({ stages, polynomials, push, byState, byShare }, q) {
  const { own, pushed } = polynomials;
  const width = stages + 1;
  let sum = 0;
  for (let k = 1, at = q * width + 1; k <= q + 1; k++, at++) sum += own[at] * byState[k];
  for (let j = 0; j < q; j++) {
    let part = 0;
    for (let k = 1, at = (q * stages + j) * width + 1; k <= q - j; k++, at++) part += pushed[at] * byShare[k];
    sum += push[j] * part;
  }
  return sum;
}

/** The new states after the last stage; returns the sum of the sizes of their errors. */
export function finish({ n, stages, polynomials, factor, share, push, q, f }, y, out) {
  const { after, error } = polynomials;
  const states = after.s;
  const errors = error.s;
  const g0 = push[0], g1 = push[1], g2 = push[2], g3 = push[3], g4 = push[4], g5 = push[5]; // prettier-ignore
  for (let k = 0, at = 0; k < stages; k++, at += stages) {
    q[k] = g0 * states[at] + g1 * states[at + 1] + g2 * states[at + 2] + g3 * states[at + 3] + g4 * states[at + 4] + g5 * states[at + 5];
    f[k] = g0 * errors[at] + g1 * errors[at + 1] + g2 * errors[at + 2] + g3 * errors[at + 3] + g4 * errors[at + 4] + g5 * errors[at + 5];
    for (let j = FEWEST; j < stages; j++) {
      q[k] += push[j] * states[at + j];
      f[k] += push[j] * errors[at + j];
    }
  }
  const x = after.x, e = error.x; // prettier-ignore
  const p1 = x[1], p2 = x[2], p3 = x[3], p4 = x[4], p5 = x[5], p6 = x[6]; // prettier-ignore
  const e4 = e[4], e5 = e[5], e6 = e[6]; // those below the order vanish // prettier-ignore
  const q0 = q[0], q1 = q[1], q2 = q[2], q3 = q[3], q4 = q[4], q5 = q[5]; // prettier-ignore
  const f0 = f[0], f1 = f[1], f2 = f[2], f3 = f[3], f4 = f[4], f5 = f[5]; // prettier-ignore
  let size = 0;
  for (let i = 0; i < n; i++) {
    const o = factor[i];
    let px = 0;
    let ex = 0;
    let ps = 0;
    let es = 0;
    for (let k = stages; k > FEWEST; k--) {
      px = (px + x[k]) * o;
      ex = (ex + e[k]) * o;
      ps = (ps + q[k - 1]) * o;
      es = (es + f[k - 1]) * o;
    }
    px = ((((((px + p6) * o + p5) * o + p4) * o + p3) * o + p2) * o + p1) * o + 1;
    ps = (((((ps + q5) * o + q4) * o + q3) * o + q2) * o + q1) * o + q0;
    const square = o * o;
    ex = (((ex + e6) * o + e5) * o + e4) * (square * square);
    es = (((((es + f5) * o + f4) * o + f3) * o + f2) * o + f1) * o + f0;
    const value = y[3 + i];
    const s = share[i];
    out[3 + i] = value * px + s * ps;
    size += Math.abs(value * ex + s * es);
  }
  return size;
}

/** One pole of the stages as the dense output takes them, u_q = sum_j gamma_qj kappa_j, after `finish`. */
export function stagesOf({ stages, beta, sums, factor, share, push }, i, y, out) {
  const kappa = new Float64Array(stages);
  for (let q = 0; q < stages; q++) {
    let x = y[3 + i];
    for (let j = 0; j < q; j++) x += beta[q * stages + j] * kappa[j];
    kappa[q] = factor[i] * x + share[i] * push[q];
    out[q] = 0;
    for (let j = 0; j <= q; j++) out[q] += sums[q * stages + j] * kappa[j];
  }
}
