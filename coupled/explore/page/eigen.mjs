// Eigenvalues of small dense matrices, and of a ring at a fixed point from those of a neighbour.

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

/** Scale rows and columns by powers of two until their sizes agree (Parlett and Reinsch, Numer. Math. 13, 293). */
function balanceMatrix(A, n) {
  for (let sweep = 0, done = false; !done && sweep < 30; sweep++) {
    done = true;
    for (let i = 0; i < n; i++) {
      let row = 0;
      let column = 0;
      for (let j = 0; j < n; j++) {
        if (j === i) continue;
        row += Math.abs(A[i * n + j]);
        column += Math.abs(A[j * n + i]);
      }
      if (row === 0 || column === 0) continue;
      const f = 2 ** Math.round(0.5 * Math.log2(row / column));
      if (f === 1 || column * f + row / f >= 0.95 * (row + column)) continue;
      done = false;
      for (let j = 0; j < n; j++) {
        A[i * n + j] /= f;
        A[j * n + i] *= f;
      }
    }
  }
}

/**
 * Eigenvalues of a real matrix, row-major, n x n, which is kept; returns { re, im }.
 * Shifted QR in double steps on the Hessenberg form (Francis; as EISPACK's hqr, Wilkinson and Reinsch 1971).
 */
export function eigenvalues(matrix, n) {
  const H = Float64Array.from(matrix);
  const re = new Float64Array(n);
  const im = new Float64Array(n);
  balanceMatrix(H, n);
  hessenberg(H, n);
  let norm = 0;
  for (let i = 0; i < n; i++) for (let j = Math.max(i - 1, 0); j < n; j++) norm += Math.abs(H[i * n + j]);
  let end = n - 1;
  let moved = 0;
  let tries = 0;
  while (end >= 0) {
    let l = end;
    for (; l > 0; l--) {
      let s = Math.abs(H[(l - 1) * n + l - 1]) + Math.abs(H[l * n + l]);
      if (s === 0) s = norm;
      if (Math.abs(H[l * n + l - 1]) <= 2.2e-16 * s) {
        H[l * n + l - 1] = 0;
        break;
      }
    }
    let x = H[end * n + end];
    if (l === end) {
      re[end] = x + moved;
      im[end--] = 0;
      tries = 0;
      continue;
    }
    let y = H[(end - 1) * n + end - 1];
    let w = H[end * n + end - 1] * H[(end - 1) * n + end];
    if (l === end - 1) {
      const p = 0.5 * (y - x);
      const q = p * p + w;
      const z = Math.sqrt(Math.abs(q));
      x += moved;
      if (q >= 0) {
        const zz = p + (p >= 0 ? z : -z);
        re[end - 1] = re[end] = x + zz;
        if (zz !== 0) re[end] = x - w / zz;
        im[end - 1] = im[end] = 0;
      } else {
        re[end - 1] = re[end] = x + p;
        im[end - 1] = z;
        im[end] = -z;
      }
      end -= 2;
      tries = 0;
      continue;
    }
    if (++tries > 120) throw new Error("the eigenvalues did not converge");
    if (tries % 10 === 0) {
      moved += x;
      for (let i = 0; i <= end; i++) H[i * n + i] -= x;
      const s = Math.abs(H[end * n + end - 1]) + Math.abs(H[(end - 1) * n + end - 2]);
      x = y = 0.75 * s;
      w = -0.4375 * s * s;
    }
    doubleStep(H, n, l, end, x, y, w);
  }
  return { re, im };
}

/** One implicit double step on rows l .. end. */
function doubleStep(H, n, l, end, x, y, w) {
  let m = end - 2;
  let p = 0;
  let q = 0;
  let r = 0;
  for (; m >= l; m--) {
    const z = H[m * n + m];
    const rr = x - z;
    const ss = y - z;
    p = (rr * ss - w) / H[(m + 1) * n + m] + H[m * n + m + 1];
    q = H[(m + 1) * n + m + 1] - z - rr - ss;
    r = H[(m + 2) * n + m + 1];
    const size = Math.abs(p) + Math.abs(q) + Math.abs(r);
    p /= size;
    q /= size;
    r /= size;
    if (m === l) break;
    const u = Math.abs(H[m * n + m - 1]) * (Math.abs(q) + Math.abs(r));
    const v = Math.abs(p) * (Math.abs(H[(m - 1) * n + m - 1]) + Math.abs(z) + Math.abs(H[(m + 1) * n + m + 1]));
    if (u <= 2.2e-16 * v) break;
  }
  for (let i = m; i < end - 1; i++) {
    H[(i + 2) * n + i] = 0;
    if (i !== m) H[(i + 2) * n + i - 1] = 0;
  }
  for (let k = m; k < end; k++) {
    const last = k === end - 1;
    if (k !== m) {
      p = H[k * n + k - 1];
      q = H[(k + 1) * n + k - 1];
      r = last ? 0 : H[(k + 2) * n + k - 1];
      x = Math.abs(p) + Math.abs(q) + Math.abs(r);
      if (x !== 0) {
        p /= x;
        q /= x;
        r /= x;
      }
    }
    let s = Math.sqrt(p * p + q * q + r * r);
    if (p < 0) s = -s;
    if (s === 0) continue;
    if (k === m) {
      if (l !== m) H[k * n + k - 1] = -H[k * n + k - 1];
    } else H[k * n + k - 1] = -s * x;
    p += s;
    x = p / s;
    y = q / s;
    const z = r / s;
    q /= p;
    r /= p;
    for (let j = k; j < n; j++) {
      let sum = H[k * n + j] + q * H[(k + 1) * n + j];
      if (!last) {
        sum += r * H[(k + 2) * n + j];
        H[(k + 2) * n + j] -= sum * z;
      }
      H[(k + 1) * n + j] -= sum * y;
      H[k * n + j] -= sum * x;
    }
    const stop = Math.min(end, k + 3);
    for (let i = 0; i <= stop; i++) {
      let sum = x * H[i * n + k] + y * H[i * n + k + 1];
      if (!last) {
        sum += z * H[i * n + k + 2];
        H[i * n + k + 2] -= sum * r;
      }
      H[i * n + k + 1] -= sum * q;
      H[i * n + k] -= sum;
    }
  }
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
