// @ts-check
/**
 * The pose of an asset: a moment of one of its clips, on its own rig, on that of its result, or between the two.
 *
 * A result may have other positions of joints, other bind poses, other translations in clips and other morph targets
 * (docs/assets.md#rigs), all at the indices of the source. three's mixer sets what one rig says and keeps no second one,
 * so the tracks are read here.
 */
import { Box3, PropertyBinding, Vector3 } from "../vendor/three/three.module.js";
import { meshesOf, originOf } from "./loading.js";

/** @typedef {{ name: string, seconds: number }} Clip */
/** @typedef {(time: number) => ArrayLike<number>} Values */
/** @typedef {{ object: any, property: string, track: number, values: Values, there: Values | null }} Motion `track`: its number in the clip */
/** @typedef {{ positions: Map<object, Vector3>, binds: { inverse: number[], from: number[], to: number[] }[] }} Other where a result has its nodes, and its inverse bind matrices */

/** The clip of a file with shapes as morph targets leads to its shape (`assets/morph.py`), which the strength does. */
const OWN = "deform";
const LOOKS = 12; // at a clip, for how far it reaches

export class Puppet {
  /** @type {Motion[][]} of each clip */ #motions;
  /** @type {Other | null} */ #other = null;
  #now = { share: 0, clip: -1, time: 0 };

  /** @param {import("three").Object3D} root as it is at rest */
  constructor(root) {
    this.root = root;
    this.nodes = [...(originOf(root)?.nodes ?? [])].map(([object, index]) => restOf(object, index));
    this.weights = meshesOf(root).flatMap((mesh) => (mesh.morphTargetInfluences ? [{ mesh, rest: mesh.morphTargetInfluences.slice() }] : []));
    const clips = clipsOf(root);
    this.#motions = clips.map(({ tracks }) => tracks.flatMap((track, k) => motionOf(root, track, k)));
    const names = namesOf(clips);
    /** @type {Clip[]} */
    this.clips = clips.map(({ duration }, i) => ({ name: names[i], seconds: duration }));
    // The spheres around meshes are those of the rest.
    if (clips.length) for (const mesh of meshesOf(root)) mesh.frustumCulled = false;
  }

  /** @returns {boolean} whether it has joints or morph targets */
  get rigged() {
    return this.weights.length > 0 || meshesOf(this.root).some((mesh) => /** @type {any} */ (mesh).isSkinnedMesh);
  }

  /** @param {import("three").Object3D | null} result whose rig is that at the end of the way */
  meet(result) {
    const now = this.#now;
    this.#set({ share: 0, clip: -1 });
    this.#other = result && otherOf(this.root, this.nodes, result);
    const clips = result ? clipsOf(result) : [];
    this.#motions.forEach((motions, i) => motions.forEach((motion) => (motion.there = thereOf(motion, clips[i]?.tracks))));
    this.#set({ ...now, share: 0 });
  }

  /** @param {string | null} name of a clip; where there is none, it is at rest @param {number} time seconds @returns {boolean} whether another clip was shown before */
  pose(name, time) {
    const { clip } = this.#now;
    this.#set({ clip: this.clips.findIndex((each) => each.name === name), time });
    return this.#now.clip !== clip;
  }

  /** Let a box around the asset at rest grow as far as the clip goes beyond it, by its joints and meshes. @param {Box3} box */
  reach(box) {
    const now = this.#now;
    if (now.clip < 0) return;
    const around = this.atRest(() => this.#joints());
    const all = around.clone();
    for (let look = 0; look < LOOKS; look++) {
      this.#set({ time: (this.clips[now.clip].seconds * look) / (LOOKS - 1) });
      all.union(this.#joints());
    }
    this.#set(now);
    box.min.add(all.min.sub(around.min));
    box.max.add(all.max.sub(around.max));
  }

  /** @returns {Box3} around the joints and meshes */
  #joints() {
    this.root.updateMatrixWorld(true);
    const objects = meshesOf(this.root).flatMap((/** @type {any} */ mesh) => mesh.skeleton?.bones ?? mesh);
    return new Box3().setFromPoints(objects.map((object) => new Vector3().setFromMatrixPosition(object.matrixWorld)));
  }

  /** @param {number} share of the way to the rig of the result */
  set share(share) {
    this.#set({ share });
  }

  /** Do something while the asset is at rest. @template T @param {() => T} act @returns {T} */
  atRest(act) {
    const now = this.#now;
    this.#set({ clip: -1 });
    this.root.updateMatrixWorld(true);
    try {
      return act();
    } finally {
      this.#set(now);
    }
  }

  /** @param {{ share?: number, clip?: number, time?: number }} change */
  #set(change) {
    const { share, clip, time } = (this.#now = { ...this.#now, ...change });
    for (const { object, position, quaternion, scale } of this.nodes) {
      object.position.copy(position);
      const there = this.#other?.positions.get(object);
      if (there) object.position.lerp(there, share);
      object.quaternion.copy(quaternion);
      object.scale.copy(scale);
    }
    for (const { inverse, from, to } of this.#other?.binds ?? []) inverse.forEach((_, i) => (inverse[i] = from[i] + share * (to[i] - from[i])));
    const weights = new Map(this.weights.map(({ mesh, rest }) => [mesh, /** @type {ArrayLike<number>} */ (rest)]));
    for (const { object, property, values, there } of this.#motions[clip] ?? []) {
      const now = values(time);
      if (property === "morphTargetInfluences") weights.set(object, now);
      else object[property].fromArray(now);
      if (property === "position" && there) object.position.lerp(new Vector3().fromArray(there(time)), share);
    }
    for (const [mesh, now] of weights) weigh(mesh, now, share);
  }
}

/** @param {any} object @param {number} index of its node */
function restOf(object, index) {
  return { object, index, position: object.position.clone(), quaternion: object.quaternion.clone(), scale: object.scale.clone() };
}

/** @param {import("three").Object3D} root */
function clipsOf(root) {
  return root.animations.filter(({ name, tracks }) => name !== OWN || !tracks.every((track) => track.name.endsWith("Influences")));
}

/** What people call the clips: without what an exporter puts before a name, and each once. @param {{ name: string }[]} clips */
function namesOf(clips) {
  const plain = clips.map(({ name }, i) => (/^animation_\d+$/.test(name) ? "" : (name.split("|").pop() ?? "").replaceAll("_", " ").trim()) || `Clip ${i + 1}`);
  return plain.map((name, i) => (plain.indexOf(name) === i ? name : `${name} (${i + 1})`));
}

/** @param {import("three").Object3D} root @param {import("three").KeyframeTrack} track @param {number} k @returns {Motion[]} none where its node is hidden */
function motionOf(root, track, k) {
  const { nodeName, propertyName } = PropertyBinding.parseTrackName(track.name);
  const object = PropertyBinding.findNode(root, nodeName);
  return object ? [{ object, property: propertyName, track: k, values: valuesOf(track), there: null }] : [];
}

/** @param {any} track @returns {Values} */
function valuesOf(track) {
  const interpolant = track.createInterpolant();
  return (time) => interpolant.evaluate(time);
}

/** @param {Motion} motion @param {any[] | undefined} tracks of the same clip of the result @returns {Values | null} */
function thereOf({ property, track }, tracks) {
  const same = tracks?.[track];
  return property === "position" && same?.name.endsWith(".position") ? valuesOf(same) : null;
}

/** @param {import("three").Object3D} root @param {{ object: any, index: number }[]} nodes @param {import("three").Object3D} result @returns {Other} */
function otherOf(root, nodes, result) {
  const found = new Map([...(originOf(result)?.nodes ?? [])].map(([object, index]) => [index, /** @type {any} */ (object).position]));
  const positions = new Map(nodes.flatMap(({ object, index }) => (found.has(index) ? [[object, found.get(index).clone()]] : [])));
  const inverses = (/** @type {any} */ mesh) => (mesh?.skeleton?.boneInverses ?? []).map((/** @type {any} */ inverse) => inverse.elements);
  const ends = meshesOf(result).map(inverses);
  // Meshes may share a skin.
  const pairs = new Map(meshesOf(root).flatMap((mesh, i) => inverses(mesh).map((/** @type {number[]} */ inverse, /** @type {number} */ k) => [inverse, ends[i]?.[k] ?? inverse])));
  return { positions, binds: [...pairs].map(([inverse, to]) => ({ inverse, from: inverse.slice(), to: to.slice() })) };
}

/** A geometry on its way has the targets of both ends (`deformation.js`). @param {any} mesh @param {ArrayLike<number>} weights @param {number} share */
function weigh({ geometry, morphTargetInfluences }, weights, share) {
  const targets = Object.values(geometry.morphAttributes)[0]?.length ?? 0;
  const all = Array.from(weights);
  const both = targets > all.length ? [...all.map((weight) => (1 - share) * weight), ...all.map((weight) => share * weight)] : all;
  // In place: the lines of a wireframe have the same list.
  morphTargetInfluences.splice(0, Infinity, ...both);
}
