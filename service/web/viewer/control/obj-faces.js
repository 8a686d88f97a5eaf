// @ts-check
/**
 * The faces of an OBJ in the order in which the service counts them. Objects, groups and materials are gathered into
 * meshes, the last one first; a polygon is a fan from its first corner. No three.js here, so that node can test it.
 */

/** @typedef {{ positions: Float64Array, corners: Uint32Array }} ObjFaces */

/** @param {string} text of the file @returns {ObjFaces | null} null where it has no faces, or one that refers to no vertex */
export function readObjFaces(text) {
  /** @type {number[]} */
  const positions = [];
  /** @type {Map<string, number[][]>} */
  const meshes = new Map();
  let [material, object, group] = ["", "", ""];
  for (const line of text.replaceAll("\r\n", "\n").replaceAll("\\\n", "").split("\n")) {
    const [word, ...rest] = line.trim().split(/\s+/);
    if (word === "v") positions.push(...rest.slice(0, 3).map(Number));
    else if (word === "usemtl") material = rest.join(" ");
    else if (word === "o") object = rest.join(" ");
    else if (word === "g") group = rest.join(" ");
    else if (word === "f") {
      const key = JSON.stringify([material, object, group]);
      const faces = meshes.get(key) ?? [];
      if (!faces.length) meshes.set(key, faces);
      const before = positions.length / 3; // relative indices count back from their line
      faces.push(rest.map((text) => parseInt(text, 10)).map((corner) => (corner > 0 ? corner - 1 : before + corner)));
    }
  }
  const vertices = positions.length / 3;
  const corners = Uint32Array.from([...meshes.values()].reverse().map(triangles).flat(2));
  if (!corners.length || corners.some((corner) => !(corner < vertices))) return null;
  return { positions: Float64Array.from(positions), corners };
}

/** @param {number[][]} faces @returns {number[][]} triangles; a quad's second one begins at the other end of the cut */
function triangles(faces) {
  return faces.flatMap(([hub, ...rest]) =>
    rest.slice(1).map((corner, i) => (rest.length === 3 && i === 1 ? [rest[1], corner, hub] : [hub, rest[i], corner])),
  );
}
