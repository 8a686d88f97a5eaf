// @ts-check
/** Assets of ours, so that nothing opens empty: files below `web/examples/`, made by `bench/page_samples.py`. The first is what forms open on. */

/** @type {{name: string, label: string}[]} */
export const SAMPLES = [
  { name: "horse.glb", label: "Horse" },
  { name: "robot.glb", label: "Robot" },
  { name: "car.glb", label: "Car" },
  { name: "teapot.glb", label: "Teapot" },
  { name: "vase.glb", label: "Vase" },
  { name: "walker.glb", label: "Walking animal" },
];
