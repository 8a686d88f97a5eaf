import assert from "node:assert/strict";
import { test } from "node:test";
import { animatedWebp } from "../../service/web/viewer/webp.js";

const chunk = (name, bytes) => Buffer.concat([Buffer.from(name), Buffer.from([bytes.length, 0, 0, 0]), Buffer.from(bytes), Buffer.alloc(bytes.length % 2)]);
const still = (...chunks) => {
  const body = Buffer.concat([Buffer.from("WEBP"), ...chunks]);
  const made = Buffer.concat([Buffer.from("RIFF"), Buffer.alloc(4), body]);
  made.writeUInt32LE(body.length, 4);
  return made.buffer.slice(made.byteOffset, made.byteOffset + made.length);
};

test("frames keep their pictures, and nothing else of a still", () => {
  const stills = [still(chunk("VP8 ", [1, 2, 3])), still(chunk("VP8X", Array(10).fill(0)), chunk("ICCP", [9]), chunk("ALPH", [4]), chunk("VP8 ", [5, 6]))];
  const made = Buffer.from(animatedWebp(stills, { width: 300, height: 200, milliseconds: 1000 }));
  assert.equal(made.readUInt32LE(4), made.length - 8);
  const canvas = chunk("VP8X", [0x12, 0, 0, 0, 43, 1, 0, 199, 0, 0]);
  const place = [0, 0, 0, 0, 0, 0, 43, 1, 0, 199, 0, 0, 232, 3, 0, 2];
  const frames = [
    chunk("ANMF", [...place, ...chunk("VP8 ", [1, 2, 3])]),
    chunk("ANMF", [...place, ...chunk("ALPH", [4]), ...chunk("VP8 ", [5, 6])]),
  ];
  assert.deepEqual(made.subarray(8), Buffer.concat([Buffer.from("WEBP"), canvas, chunk("ANIM", Array(6).fill(0)), ...frames]));
});

test("a browser that writes PNG instead is named", () => {
  assert.throws(() => animatedWebp([Buffer.from("\x89PNG".padEnd(40)).buffer], { width: 1, height: 1, milliseconds: 1 }), /cannot write WebP/);
});
