// @ts-check
/**
 * Geodesic distances by the heat method on an intrinsic Delaunay triangulation; the counterpart in Python is
 * `HeatGeodesics` in `meshdeform/kinds/surface_fit/intrinsic.py`, and a test compares the two.
 *
 *     (M + t L) u = delta        X = -grad u / |grad u|        L phi = div X
 *
 * No entry of L beside the diagonal is positive, since the triangulation is Delaunay. So the first system is solved by
 * Gauss-Seidel sweeps whose terms are all positive: heat far away keeps its digits, however small it is, and only its
 * direction counts there. The second is solved by conjugate gradients with an incomplete Cholesky factor, which exists
 * for such a matrix.
 *
 * Source: Crane, Weischedel and Wardetzky 2013, Geodesics in Heat; Meijerink and van der Vorst 1977.
 */

const SWEEPS = 2000;
const HEAT_TOLERANCE = 1e-4;
const ITERATIONS = 3000;
const RESIDUAL = 1e-5;

export class HeatGeodesics {
  /** @param {import("./intrinsic.js").Intrinsic} mesh */
  constructor({ faces: given, lengths, vertices }) {
    this.vertices = vertices;
    // Neighbours get numbers near each other: the factor drops less, and memory is read in order.
    this.rank = ranks(given, vertices);
    const { rank } = this;
    const faces = given.map((v) => rank[v]);
    this.faces = faces;
    const count = faces.length;
    this.half = new Float64Array(count); // half the cotangent opposite to each side
    this.mass = new Float64Array(vertices);
    // Corners of each face in a plane: (0, 0), (ax, 0), (cx, cy).
    this.layout = new Float64Array(count);
    let [squares, whole] = [0, 0];
    for (let f = 0; f < count; f += 3) {
      const [a, b, c] = [lengths[f], lengths[f + 1], lengths[f + 2]];
      const area = heron(a, b, c);
      const sum = a * a + b * b + c * c;
      for (let k = f; k < f + 3; k++) {
        this.half[k] = (sum - 2 * lengths[k] ** 2) / (8 * area);
        this.mass[faces[k]] += area / 3;
      }
      this.layout[f] = a;
      this.layout[f + 1] = (a * a + c * c - b * b) / (2 * a);
      this.layout[f + 2] = (2 * area) / a;
      squares += (area * sum) / 3;
      whole += area;
    }
    this.time = squares / whole; // over the area, since large triangles between many small ones need a longer time
    const rows = assemble(faces, this.half, vertices);
    this.begin = rows.begin;
    this.columns = rows.columns;
    this.values = rows.values;
    this.diagonal = rows.diagonal;
    this.middle = rows.middle;
    this.weighted = rows.values.map((value) => this.time * value);
    this.pivot = pivotsOf(rows);
    /** @type {Float64Array} The last solution, from which the next one begins. */
    this.phi = new Float64Array(vertices);
  }

  /** @param {number} source a vertex @returns {Float64Array} (V) infinite on parts without the source */
  distances(source) {
    const { rank, phi, vertices } = this;
    const start = rank[source];
    const order = nearestFirst(this, start);
    const right = this.#divergence(this.#heat(start, order));
    const inside = new Uint8Array(vertices);
    for (const v of order) inside[v] = 1;
    for (let v = 0; v < vertices; v++) if (!inside[v]) right[v] = 0;
    this.solve(right, phi);
    return Float64Array.from(rank, (v) => (inside[v] ? Math.max(phi[v] - phi[start], 0) : Infinity));
  }

  /** @param {number} source @param {Uint32Array} order */
  #heat(source, order) {
    const { begin, columns, weighted, diagonal, mass, time } = this;
    const u = new Float64Array(this.vertices);
    const inverse = mass.map((value, v) => 1 / (value + time * diagonal[v]));
    /** @param {number} v @returns {boolean} whether it still changed */
    const sweep = (v) => {
      let sum = v === source ? 1 : 0;
      for (let k = begin[v]; k < begin[v + 1]; k++) sum += weighted[k] * u[columns[k]];
      const found = sum * inverse[v];
      const changed = found - u[v] > HEAT_TOLERANCE * found;
      u[v] = found;
      return changed;
    };
    // Outwards and inwards by turns. What is near the source is done first, and what is far has no effect on it.
    for (let turn = 0, first = 0; turn < SWEEPS && first < order.length; turn++) {
      let next = order.length;
      for (let i = first; i < order.length; i++) if (sweep(order[i]) && i < next) next = i;
      for (let i = order.length - 1; i >= first; i--) if (sweep(order[i]) && i < next) next = i;
      first = next;
    }
    return u;
  }

  /** Minus the divergence of X, as the right side of L phi. @param {Float64Array} heat */
  #divergence(heat) {
    const { faces, layout, half } = this;
    const out = new Float64Array(this.vertices);
    for (let f = 0; f < faces.length; f += 3) {
      const most = Math.max(heat[faces[f]], heat[faces[f + 1]], heat[faces[f + 2]], 1e-300);
      const [u0, u1, u2] = [heat[faces[f]] / most, heat[faces[f + 1]] / most, heat[faces[f + 2]] / most];
      const [ax, cx, cy] = [layout[f], layout[f + 1], layout[f + 2]];
      // The gradient: the sum of u_k times the opposite side, turned by a quarter.
      const gx = u0 * -cy + u1 * cy;
      const gy = u0 * (cx - ax) + u1 * -cx + u2 * ax;
      const size = Math.max(Math.hypot(gx, gy), 1e-300);
      const [fx, fy] = [-gx / size, -gy / size];
      const along0 = half[f] * ax * fx;
      const along1 = half[f + 1] * ((cx - ax) * fx + cy * fy);
      const along2 = half[f + 2] * (-cx * fx - cy * fy);
      out[faces[f]] -= along0 - along2;
      out[faces[f + 1]] -= along1 - along0;
      out[faces[f + 2]] -= along2 - along1;
    }
    return out;
  }

  /** L x. @param {Float64Array} x @param {Float64Array} to where to write it */
  apply(x, to) {
    const { begin, columns, values, diagonal, vertices } = this;
    for (let v = 0; v < vertices; v++) {
      let sum = diagonal[v] * x[v];
      for (let k = begin[v]; k < begin[v + 1]; k++) sum -= values[k] * x[columns[k]];
      to[v] = sum;
    }
  }

  /** Vertices of each part of the surface. @returns {Uint32Array[]} */
  get parts() {
    const seen = new Uint8Array(this.vertices);
    const found = [];
    for (let v = 0; v < this.vertices; v++) {
      if (seen[v]) continue;
      const part = nearestFirst(this, v);
      for (const each of part) seen[each] = 1;
      found.push(part);
    }
    return found;
  }

  /** Solve L phi = right, from the given phi on. @param {Float64Array} right its sum on each part is 0 @param {Float64Array} phi */
  solve(right, phi) {
    const { begin, middle, columns, values, pivot, vertices } = this;
    const rest = new Float64Array(vertices);
    const direction = new Float64Array(vertices);
    const image = new Float64Array(vertices);
    const better = new Float64Array(vertices);
    const precondition = () => {
      for (let v = 0; v < vertices; v++) {
        let sum = rest[v];
        for (let k = begin[v]; k < middle[v]; k++) sum += values[k] * better[columns[k]];
        better[v] = sum / pivot[v];
      }
      for (let v = vertices - 1; v >= 0; v--) {
        let sum = 0;
        for (let k = middle[v]; k < begin[v + 1]; k++) sum += values[k] * better[columns[k]];
        better[v] += sum / pivot[v];
      }
    };
    this.apply(phi, image);
    let wanted = 0;
    for (let v = 0; v < vertices; v++) {
      rest[v] = right[v] - image[v];
      wanted += right[v] * right[v];
    }
    precondition();
    direction.set(better);
    let rho = dot(rest, better);
    for (let turn = 0; turn < ITERATIONS && dot(rest, rest) > RESIDUAL ** 2 * wanted; turn++) {
      this.apply(direction, image);
      const step = rho / dot(direction, image);
      if (!Number.isFinite(step)) break;
      for (let v = 0; v < vertices; v++) {
        phi[v] += step * direction[v];
        rest[v] -= step * image[v];
      }
      precondition();
      const next = dot(rest, better);
      for (let v = 0; v < vertices; v++) direction[v] = better[v] + (next / rho) * direction[v];
      rho = next;
    }
  }
}

/**
 * L in rows: neighbours and their weights, none below zero, and the diagonal.
 * @param {Uint32Array} faces
 * @param {Float64Array} half
 * @param {number} vertices
 */
function assemble(faces, half, vertices) {
  const ends = new Uint32Array(vertices + 1);
  const after = (/** @type {number} */ e) => faces[e % 3 === 2 ? e - 2 : e + 1];
  for (let e = 0; e < faces.length; e++) {
    ends[faces[e] + 1]++;
    ends[after(e) + 1]++;
  }
  for (let v = 0; v < vertices; v++) ends[v + 1] += ends[v];
  const columns = new Uint32Array(2 * faces.length);
  const values = new Float64Array(2 * faces.length);
  const at = ends.slice();
  for (let e = 0; e < faces.length; e++) {
    const [a, b] = [faces[e], after(e)];
    columns[at[a]] = b;
    values[at[a]++] = half[e];
    columns[at[b]] = a;
    values[at[b]++] = half[e];
  }
  // Both faces of an edge add to the same entry.
  const begin = new Uint32Array(vertices + 1);
  const diagonal = new Float64Array(vertices);
  const place = new Int32Array(vertices).fill(-1);
  let out = 0;
  for (let v = 0; v < vertices; v++) {
    for (let k = ends[v]; k < ends[v + 1]; k++) {
      const [column, value] = [columns[k], values[k]];
      if (column === v) continue; // an edge from a vertex to itself has no part in L
      diagonal[v] += value;
      if (place[column] < begin[v]) {
        place[column] = out;
        columns[out] = column;
        values[out++] = value;
      } else values[place[column]] += value;
    }
    begin[v + 1] = out;
  }
  // In each row those before it come first, up to `middle`.
  const middle = begin.slice(0, vertices);
  for (let v = 0; v < vertices; v++) {
    for (let k = begin[v]; k < begin[v + 1]; k++) {
      if (columns[k] > v) continue;
      const to = middle[v]++;
      [columns[k], columns[to]] = [columns[to], columns[k]];
      [values[k], values[to]] = [values[to], values[k]];
    }
  }
  // What rounding leaves below zero; the sweeps need none.
  for (let k = 0; k < out; k++) if (values[k] < 0) values[k] = 0;
  return { begin, middle, columns: columns.subarray(0, out), values: values.subarray(0, out), diagonal };
}

/** The pivots of an incomplete Cholesky factor of L with the pattern of L. @param {ReturnType<typeof assemble>} rows */
function pivotsOf({ begin, middle, columns, values, diagonal }) {
  const pivots = new Float64Array(diagonal.length);
  for (let v = 0; v < pivots.length; v++) {
    let pivot = diagonal[v] * (1 + 1e-9);
    for (let k = begin[v]; k < middle[v]; k++) pivot -= values[k] ** 2 / pivots[columns[k]];
    pivots[v] = pivot > 1e-6 * diagonal[v] ? pivot : Math.max(diagonal[v], 1e-300);
  }
  return pivots;
}

/** @param {Uint32Array} faces @param {number} vertices @returns {Uint32Array} (V) new numbers, by a walk over the surface */
function ranks(faces, vertices) {
  const rows = assemble(faces, new Float64Array(faces.length), vertices);
  const rank = new Uint32Array(vertices);
  const seen = new Uint8Array(vertices);
  let next = 0;
  for (let v = 0; v < vertices; v++) {
    if (seen[v]) continue;
    for (const found of nearestFirst(rows, v)) {
      seen[found] = 1;
      rank[found] = next++;
    }
  }
  return rank;
}

/**
 * @param {{ begin: Uint32Array, columns: Uint32Array }} rows
 * @param {number} source
 * @returns {Uint32Array} vertices of its part, by the number of edges from it
 */
function nearestFirst({ begin, columns }, source) {
  const order = new Uint32Array(begin.length - 1);
  const seen = new Uint8Array(begin.length - 1);
  order[0] = source;
  seen[source] = 1;
  let end = 1;
  for (let at = 0; at < end; at++) {
    for (let k = begin[order[at]]; k < begin[order[at] + 1]; k++) {
      if (seen[columns[k]]) continue;
      seen[columns[k]] = 1;
      order[end++] = columns[k];
    }
  }
  return order.subarray(0, end);
}

/** @param {Float64Array} a @param {Float64Array} b */
function dot(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}

/** Kahan's form of Heron's formula. @param {number} x @param {number} y @param {number} z */
function heron(x, y, z) {
  const [c, b, a] = [x, y, z].sort((one, other) => one - other);
  return 0.25 * Math.sqrt(Math.max((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)), 1e-300));
}
