// @ts-check
/** Save files to the user's disk, copy links to them, and hand a mesh that was made here to the form for a deformation. */
import { arDevice, arLink } from "../../viewer/ar.js";
import { announce, toast } from "../announce.js";
import { Asset } from "../assets.js";
import { client } from "../client.js";
import { copyText } from "../clipboard.js";
import { isTarget } from "../create/guide/model.js";
import { DEMO } from "../demo.js";
import { button, h } from "../dom.js";
import { keepDraft, lastDraft } from "../drafts.js";
import { currentKey, currentLink } from "../key.js";
import { artifactName } from "../names.js";
import { orToast } from "../problem-box.js";
import { routeHash } from "../router.js";

// Smaller files go through the page, which names them; larger ones are streamed to the disk under the server's name.
const NAMED_BYTES = 256 << 20;

/**
 * Save a file of the server.
 * @param {string} path
 * @param {string} name
 * @param {number} size
 * @param {boolean} signable Whether the server signs addresses of it, which need no key.
 * @param {import("../scope.js").Scope} scope
 */
export function download(path, name, size, signable, scope) {
  return orToast("Not downloaded", async () => {
    if (size <= NAMED_BYTES || currentLink() || (currentKey() && !signable)) {
      const response = await client.request(path, { signal: scope.signal });
      return saveBytes(await response.blob(), name);
    }
    if (!currentKey()) return save(client.url(path), name);
    const { url } = await client.json(`${path}/url`, { method: "POST", signal: scope.signal });
    save(client.url(url), name);
  });
}

/** Let the service make an artifact of a finished job, and save it. @param {any} job @param {string} name @param {import("../scope.js").Scope} scope */
export function downloadMade(job, name, scope) {
  const path = `v1/jobs/${job.id}/artifacts/${name}`;
  announce(`Making ${name}`);
  return orToast("Not made", async () => {
    const { size, warnings } = await client.json(path, { method: "POST", signal: scope.signal });
    await download(path, artifactName(job, name), size, true, scope);
    if (warnings?.length) toast(`${name}: ${warnings.join(" ")}`);
  });
}

/**
 * Show a result in the room: the device's viewer loads it by an address that needs no key.
 * @param {any} job @param {string[]} names Of the files that it has. @param {import("../scope.js").Scope} scope
 */
export function viewInRoom(job, names, scope) {
  const name = arDevice() === "ios" ? "result.usdz" : "result.glb";
  const path = `v1/jobs/${job.id}/artifacts/${name}`;
  announce("Making the file for your room");
  return orToast("Not shown", async () => {
    if (!names.includes(name)) await client.json(path, { method: "POST", signal: scope.signal });
    const { url } = await client.json(`${path}/url`, { method: "POST", signal: scope.signal });
    const link = arLink({ glb: client.url(url), usdz: client.url(url), title: job.prompt });
    document.body.append(link ?? "");
    link?.click();
    link?.remove();
  });
}

/** Deform other files as the job's asset was, and save each as a GLB. @param {any} job @param {File[]} files @param {import("../scope.js").Scope} scope */
export function deformAlike(job, files, scope) {
  return orToast("Not deformed", async () => {
    for (const file of files) {
      announce(`Deforming ${file.name}`);
      const glb = await client.apply(job, file, { filename: file.name, outside: "rigid", signal: scope.signal });
      saveBytes(new Blob([glb]), file.name.replace(/\.[^.]*$/, "") + "-edited.glb");
    }
  });
}

/**
 * Copy an address of an artifact or a job that needs no key, and say how long it works.
 * @param {string} path
 * @param {import("../scope.js").Scope} scope
 * @param {string} [opens] What it opens, where that is more than what was asked for.
 */
export function copyLink(path, scope, opens = "") {
  return orToast("No link", async () => {
    const { url, expires_at } = await client.json(`${path}/url`, { method: "POST", signal: scope.signal });
    const until = new Date(expires_at).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
    await copyText(client.url(url), `Link copied. It ${opens}needs no key and works until ${until}`);
  });
}

/** @param {Blob} blob @param {string} name */
export function saveBytes(blob, name) {
  const url = URL.createObjectURL(blob);
  save(url, name);
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

/** @param {string} url @param {string} name */
function save(url, name) {
  const link = h("a", { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
}

/**
 * Buttons that save a mesh which was made here, and that hand it to the form; the latter not for who looks by a link, and may start nothing.
 * @param {string} label Of the first.
 * @param {() => {bytes: ArrayBuffer, name: string} | null} mesh Returns a GLB; null while there is none, and then whoever shows the buttons hides them.
 */
export function meshButtons(label, mesh) {
  const made = () => {
    const { bytes, name } = mesh() ?? {};
    return bytes ? new File([bytes], name ?? "", { type: "model/gltf-binary" }) : null;
  };
  const save = () => {
    const file = made();
    if (file) saveBytes(file, file.name);
  };
  const use = (/** @type {"asset" | "target"} */ as) => async () => {
    const file = made();
    if (file) await handOn(new Asset(file, file.name), as);
  };
  const saving = button(label, save, { icon: "download" });
  if (currentLink() || DEMO) return [saving];
  return [saving, button("Deform this mesh", use("asset"), { icon: "spark" }), button("Use as target", use("target"), { class: "button-quiet" })];
}

/** What else was typed in the form stays. @param {Asset} mesh @param {"asset" | "target"} as */
async function handOn(mesh, as) {
  const last = await lastDraft();
  const { wish = {}, asset = null, files = {} } = last ?? {};
  const others = Object.fromEntries(Object.entries(files).filter(([name]) => !isTarget(name)));
  keepDraft({
    from: null,
    wish: { ...wish, guide: { ...wish.guide, targets: as === "target" ? 1 : 0 } },
    asset: as === "asset" ? mesh : asset,
    files: as === "target" ? { target: mesh } : others,
  });
  location.hash = routeHash({ name: "create", from: null });
}
