// @ts-check
/** Assets of ours, so that nothing opens empty: files below `web/examples/`, made by `bench/page_gallery.py`. */

/** @type {{name: string, label: string}[]} */
export const SAMPLES = [
  { name: "animal.glb", label: "Painted animal" },
  { name: "vase.glb", label: "Painted vase" },
  { name: "cube.glb", label: "Cube" },
  { name: "sphere.glb", label: "Sphere" },
];
