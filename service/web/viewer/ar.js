// @ts-check
/** Results in augmented reality: Quick Look of iPhone and iPad with a USDZ, Scene Viewer of Android with a GLB. */

const SCENE_VIEWER = "arvr.google.com/scene-viewer/1.0";

/** What shows models in the room on this device; "" where nothing does. @returns {"" | "ios" | "android"} */
export function arDevice() {
  if (document.createElement("a").relList?.supports?.("ar")) return "ios";
  return /\bAndroid\b/.test(navigator.userAgent) ? "android" : "";
}

/**
 * The address that opens Scene Viewer with a GLB, which it loads itself: it must need no key. @param {string} glb @param {string} title
 */
function sceneViewer(glb, title) {
  const query = new URLSearchParams({ file: new URL(glb, location.href).href, mode: "ar_preferred", title });
  const fallback = encodeURIComponent(location.href);
  return `intent://${SCENE_VIEWER}?${query}#Intent;scheme=https;package=com.google.android.googlequicksearchbox;action=android.intent.action.VIEW;S.browser_fallback_url=${fallback};end;`;
}

/**
 * A link that shows a model in the room; null where the device does not, or there is no file for it.
 * @param {{glb?: string, usdz?: string, title?: string}} model Addresses that need no key.
 * @param {string} [device] Default: this one.
 */
export function arLink({ glb = "", usdz = "", title = "3D model" }, device = arDevice()) {
  const href = device === "ios" ? usdz : device === "android" && glb ? sceneViewer(glb, title) : "";
  if (!href) return null;
  const link = Object.assign(document.createElement("a"), { href, className: "ar" });
  if (device === "ios") link.rel = "ar";
  // Quick Look opens only from a link whose one child is a picture, which carries the words.
  const picture = Object.assign(document.createElement("img"), { alt: "View in your room", src: PICTURE, width: 148, height: 44 });
  link.append(picture);
  return link;
}

/** The words with a box, as a picture. */
const PICTURE = `data:image/svg+xml,${encodeURIComponent(
  '<svg xmlns="http://www.w3.org/2000/svg" width="148" height="44" viewBox="0 0 148 44"><rect x=".5" y=".5" width="147" height="43" rx="21.5" fill="#fffefb" stroke="#857f75"/>' +
    '<g fill="none" stroke="#1d1b18" stroke-width="1.6" stroke-linejoin="round"><path d="m22 12 9 5v10l-9 5-9-5V17zm-9 5 9 5 9-5m-9 5v10"/></g>' +
    '<text x="40" y="27" font-family="system-ui, sans-serif" font-size="13" fill="#1d1b18">View in your room</text></svg>',
)}`;
