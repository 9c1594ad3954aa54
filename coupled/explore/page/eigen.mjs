// Small dense matrices: eigenvalues and elimination; and where a function changes.

/**
 * Eigenvalues of a real matrix, row-major, n x n, which is kept; returns { re, im }.
 *
 * Complex rotations of rows and columns k, k + 1 keep the eigenvalues. They take the matrix to upper Hessenberg form, column by
 * column. A QR step with a shift then is a first such rotation and those that restore the form below it (Francis).
 */
export function eigenvalues(matrix, n) {
  const [re, im] = [Float64Array.from(matrix), new Float64Array(n * n)];
  let [first, end] = [0, n - 1]; // of the rows and columns that are worked on
  // entries p, q -> conj(c) p + conj(s) q, c q - s p
  const rotate = (p, q, cr, ci, sr, si) => {
    const [pr, pi, qr, qi] = [re[p], im[p], re[q], im[q]];
    re[p] = cr * pr + ci * pi + sr * qr + si * qi;
    im[p] = cr * pi - ci * pr + sr * qi - si * qr;
    re[q] = cr * qr - ci * qi - sr * pr + si * pi;
    im[q] = cr * qi + ci * qr - sr * pi - si * pr;
  };
  // the rotation that takes the entries of rows k and k + 1 in a column, less a shift of the diagonal, to r and 0
  const turn = (k, column, lowest, shift = [0, 0]) => {
    const [p, q] = [k * n + column, (k + 1) * n + column];
    const [pr, pi] = [re[p] - shift[0], im[p] - shift[1]];
    const r = Math.sqrt(pr * pr + pi * pi + re[q] * re[q] + im[q] * im[q]);
    if (r < 1e-150) return; // squares of such entries underflow
    const [cr, ci, sr, si] = [pr / r, pi / r, re[q] / r, im[q] / r];
    for (let j = column; j <= end; j++) rotate(k * n + j, (k + 1) * n + j, cr, ci, sr, si);
    for (let i = first; i <= lowest; i++) rotate(i * n + k, i * n + k + 1, cr, -ci, sr, -si);
  };
  for (let column = 0; column < n - 2; column++) {
    for (let k = n - 2; k > column; k--) turn(k, column, end);
  }
  const size = (i, j) => Math.abs(re[i * n + j]) + Math.abs(im[i * n + j]);
  const norm = re.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
  for (let tries = 0; end > 0; ) {
    first = end;
    while (first > 0 && size(first, first - 1) > 2.2e-16 * (size(first, first) + size(first - 1, first - 1) + 1e-16 * norm)) first--;
    if (first === end) [end, tries] = [end - 1, 0];
    else if (++tries > 120) throw new Error("the eigenvalues did not converge");
    else {
      turn(first, first, Math.min(first + 2, end), tries % 10 ? shiftOf(re, im, n, end) : [size(end, end - 1) + size(end, end), 0]);
      for (let k = first + 1; k < end; k++) turn(k, k - 1, Math.min(k + 2, end));
    }
  }
  const diagonal = (x) => Float64Array.from({ length: n }, (_, k) => x[k * n + k]);
  return { re: diagonal(re), im: diagonal(im) };
}

/** The eigenvalue of the 2 x 2 block [[a, b], [c, d]] that ends at row `end` which lies nearest to d, [re, im]. */
function shiftOf(re, im, n, end) {
  const [a, b, c, d] = [(end - 1) * n + end - 1, (end - 1) * n + end, end * n + end - 1, end * n + end];
  const [hr, hi] = [(re[a] - re[d]) / 2, (im[a] - im[d]) / 2];
  const [qr, qi] = [hr * hr - hi * hi + re[b] * re[c] - im[b] * im[c], 2 * hr * hi + re[b] * im[c] + im[b] * re[c]];
  const x = Math.sqrt((Math.hypot(qr, qi) + qr) / 2); // x + i y is the root of h^2 + b c
  const y = Math.sqrt((Math.hypot(qr, qi) - qr) / 2) * (qi < 0 ? -1 : 1);
  const sign = hr * x + hi * y < 0 ? -1 : 1;
  return [re[d] + hr - sign * x, im[d] + hi - sign * y];
}

/** Solve linear equations, rows of coefficients and right-hand side, by elimination with pivots; the rows are overwritten. */
export function solve(rows) {
  const n = rows.length;
  for (let j = 0; j < n; j++) {
    let pivot = j;
    for (let i = j + 1; i < n; i++) if (Math.abs(rows[i][j]) > Math.abs(rows[pivot][j])) pivot = i;
    [rows[j], rows[pivot]] = [rows[pivot], rows[j]];
    for (let i = 0; i < n; i++) {
      const f = i === j ? 0 : rows[i][j] / rows[j][j];
      for (let k = j; f !== 0 && k <= n; k++) rows[i][k] -= f * rows[j][k];
    }
  }
  return rows.map((row, i) => row[n] / row[i]);
}

/** Where `holds` ceases to hold between a, where it does, and b, by bisection. */
export function bisect(holds, a, b, times = 60) {
  for (let k = 0; k < times; k++) [a, b] = holds(0.5 * (a + b)) ? [0.5 * (a + b), b] : [a, 0.5 * (a + b)];
  return 0.5 * (a + b);
}
