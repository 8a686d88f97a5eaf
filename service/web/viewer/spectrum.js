// @ts-check
/**
 * The smallest eigenvalues of the Laplacian, L x = lambda M x, and their eigenfunctions, by subspace iteration: L is
 * inverted by the conjugate gradients of heat.js. The counterpart in Python is `spectrum` in
 * `meshdeform/kinds/surface_fit/intrinsic.py`; a test compares the two.
 *
 * Source: Bathe and Wilson 1972.
 */
import { generator } from "./samples.js";

const GUARDS = 6; // functions that are computed besides, so that the last wanted one converges
const ROUNDS = 12;
const CHANGE = 1e-4;

/**
 * @param {import("./heat.js").HeatGeodesics} solver
 * @param {number} count of eigenvalues above zero
 * @returns {{ values: number[], functions: Float32Array[] }} ascending; each function (V) has the norm 1 under M
 */
export function spectrum(solver, count) {
  const { mass, rank, vertices } = solver;
  const size = Math.min(count + GUARDS, vertices - 2);
  const random = generator(1);
  /** @type {Float64Array[]} */
  let basis = Array.from({ length: size }, () => Float64Array.from({ length: vertices }, () => random() - 0.5));
  const image = new Float64Array(vertices);
  const right = new Float64Array(vertices);
  /** @type {number[]} */
  let values = [];
  orthonormalise(basis, mass, solver.parts);
  for (let round = 0; round < ROUNDS; round++) {
    basis = basis.map((x, i) => {
      for (let v = 0; v < vertices; v++) right[v] = mass[v] * x[v];
      const begin = values.length ? 1 / Math.max(values[i], 1e-300) : 0;
      const found = x.map((value) => begin * value);
      solver.solve(right, found);
      return found;
    });
    orthonormalise(basis, mass, solver.parts);
    const small = basis.map(() => new Float64Array(size));
    for (let i = 0; i < size; i++) {
      solver.apply(basis[i], image);
      for (let j = 0; j <= i; j++) {
        let sum = 0;
        for (let v = 0; v < vertices; v++) sum += basis[j][v] * image[v];
        small[i][j] = small[j][i] = sum;
      }
    }
    const { values: found, vectors } = eigen(small);
    basis = vectors.map((weights) => {
      const out = new Float64Array(vertices);
      for (let j = 0; j < size; j++) for (let v = 0; v < vertices; v++) out[v] += weights[j] * basis[j][v];
      return out;
    });
    const settled = values.length && found.slice(0, count).every((value, i) => Math.abs(value - values[i]) <= CHANGE * value);
    values = found;
    if (settled) break;
  }
  const kept = basis.slice(0, count);
  return { values: values.slice(0, count), functions: kept.map((x) => Float32Array.from(rank, (v) => x[v])) };
}

/**
 * Make functions orthonormal under M, and orthogonal to the constants of all parts, whose eigenvalue is 0.
 * @param {Float64Array[]} basis @param {Float64Array} mass @param {Uint32Array[]} parts
 */
function orthonormalise(basis, mass, parts) {
  for (let i = 0; i < basis.length; i++) {
    const x = basis[i];
    for (let again = 0; again < 2; again++) {
      for (const part of parts) {
        let [sum, whole] = [0, 0];
        for (const v of part) {
          sum += mass[v] * x[v];
          whole += mass[v];
        }
        for (const v of part) x[v] -= sum / whole;
      }
      for (let j = 0; j < i; j++) {
        const share = inner(x, basis[j], mass);
        for (let v = 0; v < x.length; v++) x[v] -= share * basis[j][v];
      }
    }
    const size = Math.sqrt(inner(x, x, mass)) || 1;
    for (let v = 0; v < x.length; v++) x[v] /= size;
  }
}

/** @param {Float64Array} a @param {Float64Array} b @param {Float64Array} mass */
function inner(a, b, mass) {
  let sum = 0;
  for (let v = 0; v < a.length; v++) sum += mass[v] * a[v] * b[v];
  return sum;
}

/**
 * Eigenvalues, ascending, and eigenvectors of a small symmetric matrix, by Jacobi's rotations.
 * @param {Float64Array[]} matrix is changed
 */
function eigen(matrix) {
  const size = matrix.length;
  const vectors = matrix.map((_, i) => Float64Array.from({ length: size }, (_, j) => Number(i === j)));
  for (let sweep = 0; sweep < 30; sweep++) {
    let off = 0;
    let on = 0;
    for (let i = 0; i < size; i++) for (let j = 0; j < size; j++) (i === j ? (on += matrix[i][j] ** 2) : (off += matrix[i][j] ** 2));
    if (off <= 1e-20 * on) break;
    for (let p = 0; p < size; p++) {
      for (let q = p + 1; q < size; q++) {
        if (matrix[p][q] === 0) continue;
        const theta = (matrix[q][q] - matrix[p][p]) / (2 * matrix[p][q]);
        const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
        const c = 1 / Math.sqrt(t * t + 1);
        const s = t * c;
        for (let k = 0; k < size; k++) [matrix[k][p], matrix[k][q]] = [c * matrix[k][p] - s * matrix[k][q], s * matrix[k][p] + c * matrix[k][q]];
        for (let k = 0; k < size; k++) [matrix[p][k], matrix[q][k]] = [c * matrix[p][k] - s * matrix[q][k], s * matrix[p][k] + c * matrix[q][k]];
        for (let k = 0; k < size; k++) [vectors[p][k], vectors[q][k]] = [c * vectors[p][k] - s * vectors[q][k], s * vectors[p][k] + c * vectors[q][k]];
      }
    }
  }
  const order = matrix.map((_, i) => i).sort((a, b) => matrix[a][a] - matrix[b][b]);
  return { values: order.map((i) => matrix[i][i]), vectors: order.map((i) => vectors[i]) };
}
