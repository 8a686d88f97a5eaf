/** Pack meshes into a ZIP without compressing them. Names, sizes and checksums as PKWARE's APPNOTE 6.3.10, section 4.3, says. */

const UTF8_NAMES = 0x0800;
// 1 January 1980: the same files are the same ZIP.
const DAY = 0x0021;

const TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  let value = byte;
  for (let bit = 0; bit < 8; bit += 1) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value;
});

/** Pack meshes into a ZIP; the same meshes give the same bytes. */
export async function packMeshes(meshes: readonly File[]): Promise<Blob> {
  const names = namesInZip(meshes.map(({ name }) => name));
  return zip(await Promise.all(meshes.map(async (file, at) => ({ name: names[at]!, bytes: new Uint8Array(await file.arrayBuffer()) }))));
}

/** Return names for files in a ZIP, none of them twice. */
export function namesInZip(given: readonly string[]): string[] {
  const used = new Set<string>();
  return given.map((name) => {
    const plain = name.split(/[\\/]/).pop() || "mesh.glb";
    const [stem, ending] = [plain.replace(/\.[^.]*$/, ""), plain.slice(plain.lastIndexOf("."))];
    let found = plain;
    for (let number = 2; used.has(found.toLowerCase()); number += 1) found = `${stem}-${number}${ending}`;
    used.add(found.toLowerCase());
    return found;
  });
}

/** Write a ZIP of files whose names differ, with "/" between folders. */
export function zip(files: readonly { name: string; bytes: Uint8Array<ArrayBuffer> }[]): Blob {
  const parts: Uint8Array<ArrayBuffer>[] = [];
  const directory: Uint8Array<ArrayBuffer>[] = [];
  let offset = 0;
  for (const { name, bytes } of files) {
    const text = new TextEncoder().encode(name);
    const common: Field[] = [
      [2, 20], [2, UTF8_NAMES], [2, 0], [2, 0], [2, DAY], [4, crc32(bytes)], [4, bytes.length], [4, bytes.length], [2, text.length], [2, 0],
    ];
    const head = fields([[4, 0x04034b50], ...common], text);
    directory.push(fields([[4, 0x02014b50], [2, 20], ...common, [2, 0], [2, 0], [2, 0], [4, 0], [4, offset]], text));
    parts.push(head, bytes);
    offset += head.length + bytes.length;
  }
  const size = directory.reduce((sum, entry) => sum + entry.length, 0);
  const end = fields([[4, 0x06054b50], [2, 0], [2, 0], [2, files.length], [2, files.length], [4, size], [4, offset], [2, 0]]);
  return new Blob([...parts, ...directory, end], { type: "application/zip" });
}

/** Return the checksum of a ZIP's entries (CRC-32, IEEE 802.3). */
export function crc32(bytes: Uint8Array): number {
  let value = 0xffffffff;
  for (const byte of bytes) value = (value >>> 8) ^ TABLE[(value ^ byte) & 0xff]!;
  return (value ^ 0xffffffff) >>> 0;
}

/** A number of bytes, and a value, which is written with its lowest byte first. */
type Field = [2 | 4, number];

function fields(values: readonly Field[], tail = new Uint8Array()): Uint8Array<ArrayBuffer> {
  const length = values.reduce((sum, [size]) => sum + size, 0);
  const made = new Uint8Array(length + tail.length);
  const view = new DataView(made.buffer);
  let at = 0;
  for (const [size, value] of values) {
    if (size === 2) view.setUint16(at, value, true);
    else view.setUint32(at, value, true);
    at += size;
  }
  made.set(tail, length);
  return made;
}
