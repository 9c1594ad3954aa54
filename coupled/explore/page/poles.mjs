// The poles of heat within one Rosenbrock step: all that is done for each of them.
//
// They are linear, so that with kappa_q = h k_q the matrices a and c of the method act as one, beta = alpha + gamma:
//   kappa_q = -h rate/(1 + gamma h rate) (x + sum_j beta_qj kappa_j) + h gain/(1 + gamma h rate) push_q
// push_q = absorbed power at the stage + w.u_q is one number for all poles. The new state x + sum_q beta_lq kappa_q is
// the argument of the last stage plus gamma kappa_l; the error estimate is sum_q gamma_lq kappa_q.

/** Room for the poles of one system under one method. */
export function polesOf({ gain, rate }, method) {
  const n = rate.length;
  const room = () => new Float64Array(n);
  return { n, gain, rate, stages: method.stages, beta: method.beta, gamma: method.gamma, sums: method.sums, own: room(), share: room(), sum: new Float64Array(1), kappa: new Float64Array(method.stages * n) };
}

/** Prepare a step of h ns from y: stage 0 without its push; sets sum[0] to its sum, returns sum_i h gain_i/(1 + gamma h rate_i). */
export function prepare({ n, gain, rate, gamma, own, share, kappa, sum }, y, h) {
  const gh = gamma * h;
  let G = 0;
  let all = 0;
  for (let i = 0; i < n; i++) {
    const r = rate[i];
    const d = h / (1 + gh * r);
    const f = -r * d;
    const g = gain[i] * d;
    const v = f * y[3 + i];
    own[i] = f;
    share[i] = g;
    kappa[i] = v;
    G += g;
    all += v;
  }
  sum[0] = all;
  return G;
}

/**
 * Stage q > 0 without its own push: the sum of kappa_q over the poles. It first adds `push`, of the stage before, to
 * that stage. Each stage has a loop of its own, with what it needs in registers: this is most of the work of a step.
 */
export function stageOf({ n, beta, stages, own, share, kappa }, q, y, push, out) {
  const row = q * stages;
  const e = q * n;
  const before = e - n;
  let sum = 0;
  if (q === 1) {
    const b0 = beta[row];
    for (let i = 0; i < n; i++) {
      const k0 = kappa[i] + push * share[i];
      const v = own[i] * (y[3 + i] + b0 * k0);
      kappa[i] = k0;
      kappa[e + i] = v;
      sum += v;
    }
  } else if (q === 2) {
    const b0 = beta[row], b1 = beta[row + 1]; // prettier-ignore
    for (let i = 0; i < n; i++) {
      const k1 = kappa[before + i] + push * share[i];
      const v = own[i] * (y[3 + i] + b0 * kappa[i] + b1 * k1);
      kappa[before + i] = k1;
      kappa[e + i] = v;
      sum += v;
    }
  } else if (q === 3) {
    const b0 = beta[row], b1 = beta[row + 1], b2 = beta[row + 2]; // prettier-ignore
    for (let i = 0; i < n; i++) {
      const k2 = kappa[before + i] + push * share[i];
      const v = own[i] * (y[3 + i] + b0 * kappa[i] + b1 * kappa[n + i] + b2 * k2);
      kappa[before + i] = k2;
      kappa[e + i] = v;
      sum += v;
    }
  } else if (q === 4) {
    const b0 = beta[row], b1 = beta[row + 1], b2 = beta[row + 2], b3 = beta[row + 3]; // prettier-ignore
    const o2 = 2 * n;
    for (let i = 0; i < n; i++) {
      const k3 = kappa[before + i] + push * share[i];
      const v = own[i] * (y[3 + i] + b0 * kappa[i] + b1 * kappa[n + i] + b2 * kappa[o2 + i] + b3 * k3);
      kappa[before + i] = k3;
      kappa[e + i] = v;
      sum += v;
    }
  } else {
    const b0 = beta[row], b1 = beta[row + 1], b2 = beta[row + 2], b3 = beta[row + 3], b4 = beta[row + 4]; // prettier-ignore
    const o2 = 2 * n, o3 = 3 * n, o4 = 4 * n; // prettier-ignore
    for (let i = 0; i < n; i++) {
      kappa[before + i] += push * share[i];
      let x = y[3 + i] + b0 * kappa[i] + b1 * kappa[n + i] + b2 * kappa[o2 + i] + b3 * kappa[o3 + i] + b4 * kappa[o4 + i];
      for (let j = 5; j < q; j++) x += beta[row + j] * kappa[j * n + i];
      const v = own[i] * x;
      out[3 + i] = x;
      kappa[e + i] = v;
      sum += v;
    }
  }
  return sum;
}

/** The new states after the last stage; returns the sum of the sizes of their errors. */
export function finish({ n, stages, gamma, sums, share, kappa }, push, out) {
  const last = (stages - 1) * n;
  const row = (stages - 1) * stages;
  const g0 = sums[row], g1 = sums[row + 1], g2 = sums[row + 2], g3 = sums[row + 3], g4 = sums[row + 4]; // prettier-ignore
  const o2 = 2 * n, o3 = 3 * n, o4 = 4 * n; // prettier-ignore
  let size = 0;
  for (let i = 0; i < n; i++) {
    const whole = kappa[last + i] + push * share[i];
    kappa[last + i] = whole;
    const k = gamma * whole;
    out[3 + i] += k;
    let error = k + g0 * kappa[i] + g1 * kappa[n + i] + g2 * kappa[o2 + i] + g3 * kappa[o3 + i] + g4 * kappa[o4 + i];
    for (let j = 5; j < stages - 1; j++) error += sums[row + j] * kappa[j * n + i];
    size += Math.abs(error);
  }
  return size;
}

/** One pole of the stages as the dense output takes them, u_q = sum_j gamma_qj kappa_j, after `finish`. */
export function stagesOf({ n, stages, sums, kappa }, i, out) {
  for (let q = 0; q < stages; q++) {
    out[q] = 0;
    for (let j = 0; j <= q; j++) out[q] += sums[q * stages + j] * kappa[j * n + i];
  }
}
