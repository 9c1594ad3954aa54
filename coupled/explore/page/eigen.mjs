// Small dense matrices: eigenvalues and elimination; and where a function changes.

/** Reduce a matrix (row-major, n x n, overwritten) to upper Hessenberg form by elimination with pivots. */
function hessenberg(A, n) {
  for (let m = 1; m < n - 1; m++) {
    let pivot = m;
    for (let i = m + 1; i < n; i++) {
      if (Math.abs(A[i * n + m - 1]) > Math.abs(A[pivot * n + m - 1])) pivot = i;
    }
    const x = A[pivot * n + m - 1];
    if (x === 0) continue;
    if (pivot !== m) {
      for (let j = m - 1; j < n; j++) [A[m * n + j], A[pivot * n + j]] = [A[pivot * n + j], A[m * n + j]];
      for (let i = 0; i < n; i++) [A[i * n + m], A[i * n + pivot]] = [A[i * n + pivot], A[i * n + m]];
    }
    for (let i = m + 1; i < n; i++) {
      const y = A[i * n + m - 1] / x;
      if (y === 0) continue;
      A[i * n + m - 1] = 0;
      for (let j = m; j < n; j++) A[i * n + j] -= y * A[m * n + j];
      for (let k = 0; k < n; k++) A[k * n + m] += y * A[k * n + i];
    }
  }
}

/**
 * Eigenvalues of a real matrix, row-major, n x n, which is kept; returns { re, im }.
 * QR steps with Wilkinson's shift on the Hessenberg form, in complex arithmetic (as EISPACK's comqr).
 */
export function eigenvalues(matrix, n) {
  const [re, im] = [Float64Array.from(matrix), new Float64Array(n * n)];
  hessenberg(re, n);
  const size = (i, j) => Math.abs(re[i * n + j]) + Math.abs(im[i * n + j]);
  const norm = re.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
  for (let end = n - 1, tries = 0; end > 0; ) {
    let first = end;
    while (first > 0 && size(first, first - 1) > 2.2e-16 * (size(first, first) + size(first - 1, first - 1) + 1e-16 * norm)) first--;
    if (first === end) [end, tries] = [end - 1, 0];
    else if (++tries > 120) throw new Error("the eigenvalues did not converge");
    else qrStep(re, im, n, first, end, tries % 10 ? shiftOf(re, im, n, end) : [size(end, end - 1) + size(end, end), 0]);
  }
  const diagonal = (x) => Float64Array.from({ length: n }, (_, k) => x[k * n + k]);
  return { re: diagonal(re), im: diagonal(im) };
}

/** The eigenvalue of the 2 x 2 block [[a, b], [c, d]] that ends at row `end` which lies nearest to d, [re, im]. */
function shiftOf(re, im, n, end) {
  const [a, b, c, d] = [(end - 1) * n + end - 1, (end - 1) * n + end, end * n + end - 1, end * n + end];
  const [hr, hi] = [(re[a] - re[d]) / 2, (im[a] - im[d]) / 2];
  const [wr, wi] = [re[b] * re[c] - im[b] * im[c], re[b] * im[c] + im[b] * re[c]];
  const [qr, qi] = [hr * hr - hi * hi + wr, 2 * hr * hi + wi];
  let x = Math.sqrt((Math.hypot(qr, qi) + Math.abs(qr)) / 2); // the larger part of the root of h^2 + w
  let y = x > 0 ? qi / (2 * x) : 0;
  if (qr < 0) [x, y] = [Math.abs(y), qi < 0 ? -x : x];
  const sign = hr * x + hi * y < 0 ? -1 : 1;
  const [ur, ui] = [hr + sign * x, hi + sign * y];
  const square = ur * ur + ui * ui;
  return square > 0 ? [re[d] - (wr * ur + wi * ui) / square, im[d] - (wi * ur - wr * ui) / square] : [re[d], im[d]];
}

/** One QR step with a shift on the rows and columns first .. end: rotations from the left, and their inverses from the right. */
function qrStep(re, im, n, first, end, [shiftR, shiftI]) {
  // entries p, q -> conj(c) p + conj(s) q, c q - s p
  const rotate = (p, q, cr, ci, sr, si) => {
    const [pr, pi, qr, qi] = [re[p], im[p], re[q], im[q]];
    re[p] = cr * pr + ci * pi + sr * qr + si * qi;
    im[p] = cr * pi - ci * pr + sr * qi - si * qr;
    re[q] = cr * qr - ci * qi - sr * pr + si * pi;
    im[q] = cr * qi + ci * qr - sr * pi - si * pr;
  };
  const shifted = (sign) => {
    for (let k = first; k <= end; k++) {
      re[k * n + k] += sign * shiftR;
      im[k * n + k] += sign * shiftI;
    }
  };
  shifted(-1);
  const rotations = [];
  for (let k = first; k < end; k++) {
    const [p, q] = [k * n + k, (k + 1) * n + k];
    const r = Math.hypot(re[p], im[p], re[q], im[q]) || 1;
    rotations.push([re[p] / r, im[p] / r, re[q] / r, im[q] / r]);
    for (let j = k; j <= end; j++) rotate(k * n + j, (k + 1) * n + j, ...rotations.at(-1));
  }
  rotations.forEach(([cr, ci, sr, si], i) => {
    const k = first + i;
    for (let j = first; j <= k + 1; j++) rotate(j * n + k, j * n + k + 1, cr, -ci, sr, -si);
  });
  shifted(1);
}

/** Solve A x = b by elimination with pivots; both are overwritten, and b is returned. */
export function solve(A, b, n) {
  for (let j = 0; j < n; j++) {
    let pivot = j;
    for (let i = j + 1; i < n; i++) if (Math.abs(A[i * n + j]) > Math.abs(A[pivot * n + j])) pivot = i;
    if (pivot !== j) {
      for (let k = j; k < n; k++) [A[j * n + k], A[pivot * n + k]] = [A[pivot * n + k], A[j * n + k]];
      [b[j], b[pivot]] = [b[pivot], b[j]];
    }
    for (let i = j + 1; i < n; i++) {
      const f = A[i * n + j] / A[j * n + j];
      if (f === 0) continue;
      for (let k = j + 1; k < n; k++) A[i * n + k] -= f * A[j * n + k];
      b[i] -= f * b[j];
    }
  }
  for (let i = n - 1; i >= 0; i--) {
    for (let j = i + 1; j < n; j++) b[i] -= A[i * n + j] * b[j];
    b[i] /= A[i * n + i];
  }
  return b;
}

/** Where `holds` ceases to hold between a, where it does, and b, by bisection. */
export function bisect(holds, a, b, times = 60) {
  for (let k = 0; k < times; k++) [a, b] = holds(0.5 * (a + b)) ? [0.5 * (a + b), b] : [a, 0.5 * (a + b)];
  return 0.5 * (a + b);
}
