// @ts-check
/**
 * The faces of an OBJ in the order in which the service counts them: that of its reader, trimesh. Objects, groups and
 * materials are gathered into meshes, the last one first; where all faces of a mesh are quads, their first halves come
 * before their second halves. No three.js here, so that node can test it.
 */

/** @typedef {{ corners: number[], columns: number }} Polygon `columns`: how many numbers its line has */
/** @typedef {{ positions: Float64Array, corners: Uint32Array, counts: number[] }} ObjFaces `counts`: triangles of each mesh */

/** @param {string} text of the file @returns {ObjFaces | null} null where it has no faces, or one that refers to no vertex */
export function readObjFaces(text) {
  /** @type {number[]} */
  const places = [];
  /** @type {Map<string, Polygon[]>} */
  const meshes = new Map();
  let [material, object, group] = ["", "", ""];
  for (const line of text.replaceAll("\r\n", "\n").replaceAll("\\\n", "").split("\n")) {
    const [word, ...rest] = line.trim().split(/\s+/);
    if (word === "v") places.push(...rest.slice(0, 3).map(Number));
    else if (word === "usemtl") material = rest.join(" ");
    else if (word === "o") object = rest.join(" ");
    else if (word === "g") group = rest.join(" ");
    else if (word === "f") {
      const key = JSON.stringify([material, object, group]);
      const faces = meshes.get(key) ?? [];
      if (!faces.length) meshes.set(key, faces);
      faces.push({ corners: rest.map((corner) => parseInt(corner, 10)), columns: rest.join("/").split("/").filter(Boolean).length });
    }
  }
  const vertices = places.length / 3;
  const parts = [...meshes.values()].reverse().map(triangles);
  const corners = Uint32Array.from(parts.flat(2), (corner) => (corner > 0 ? corner - 1 : vertices + corner));
  if (!corners.length || corners.some((corner) => !(corner < vertices))) return null;
  return { positions: Float64Array.from(places), corners, counts: parts.map((part) => part.length) };
}

/** @param {Polygon[]} faces @returns {number[][]} triangles */
function triangles(faces) {
  if (faces.every(({ corners, columns }) => corners.length === 4 && columns === faces[0].columns)) {
    return [...faces.map(({ corners: [a, b, c] }) => [a, b, c]), ...faces.map(({ corners: [a, , c, d] }) => [c, d, a])];
  }
  return faces.flatMap(({ corners: [hub, ...rest] }) => rest.slice(1).map((corner, i) => [hub, rest[i], corner]));
}
