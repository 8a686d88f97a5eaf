// @ts-check
/** Hand a mesh that was made here to the form for a deformation, as its asset or as its target. */
import { Asset } from "../assets.js";
import { button, h } from "../dom.js";
import { keepDraft, lastDraft } from "../drafts.js";
import { currentLink } from "../key.js";
import { routeHash } from "../router.js";

/**
 * Two buttons; none for who looks by a link, who may start nothing.
 * @param {() => Promise<{bytes: ArrayBuffer, name: string} | null>} mesh Returns a GLB; null while there is none.
 */
export function handOnButtons(mesh) {
  if (currentLink()) return null;
  const use = (/** @type {"asset" | "target"} */ part) => async () => {
    const made = await mesh();
    if (made) await handOn(new Asset(new Blob([made.bytes], { type: "model/gltf-binary" }), made.name), part);
  };
  return h("div", { class: "row" }, button("Deform this mesh", use("asset"), { icon: "spark" }), button("Use as target", use("target"), { class: "button-quiet" }));
}

/** What else was typed in the form stays. @param {Asset} mesh @param {"asset" | "target"} part */
async function handOn(mesh, part) {
  const last = await lastDraft();
  const { wish = {}, asset = null, files = {} } = last ?? {};
  const { target: _, ...others } = files;
  keepDraft({
    from: null,
    wish: { ...wish, guide: { ...wish.guide, align: "", landmarks: [], target: part === "target" } },
    asset: part === "asset" ? mesh : asset,
    files: part === "target" ? { target: mesh } : others,
  });
  location.hash = routeHash({ name: "create", from: null });
}
