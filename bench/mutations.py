"""Generate the damaged files for `bench/fuzz.py`.

A change here changes the file of each seed and number.
"""

from __future__ import annotations

import base64
import io
import json
import random
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]

LARGEST = 2**20
"""Bytes of the largest mutant."""
_NUMBERS = [-1, 0, 1, 2, 3, 4, 255, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**53, 2**64, 10**400, -(2**40)]
_FLOATS = [-0.0, 0.5, 1e-300, 1e300, 3.4e38, -3.5e38, 1e-45]
_TEXTS = ["", "VEC3", "MAT4", "SCALAR", "data:,", "data:;base64,####", "data:;base64,AAAA", "x.bin", "\ud800", "2.0"]
_TYPES = [5120, 5121, 5122, 5123, 5125, 5126]
_WORDS = [
    *(b"-1", b"0", b"1e400", b"nan", b"4000000000", b"-2147483648", b"1/1/1", b"//", b"\\\n", b"#", b"\r", b"\0"),
    *(b"\xff", b"\nf ", b"\nv ", b"\nvt 1", b"\nusemtl x", b"\nmtllib a b", b"\ng ", b"\nmap_Kd ../x", b"\nd 2"),
    *(b"solid", b"facet", b"vertex", b"endsolid", b"COLOR=", b"list uchar int", b"element face 9", b"end_header\n"),
    *(b"binary_big_endian", b"ascii", b"double", b"uchar", b"comment TextureFile x.png", b"property int texnumber"),
]
"""Pieces of texts, and what they do not expect."""


@cache
def corpus() -> list[tuple[str, bytes]]:
    """Return the undamaged files: (name, file)."""
    from meshdeform.assets import load_asset
    from tests.unit.assets import test_extensions, test_formats, test_ply_reader, test_stl_reader
    from tests.unit.assets.archives import packed
    from tests.unit.assets.builders import quad
    from tests.unit.assets.test_archive import MTL
    from tests.unit.assets.test_archive import OBJ as OBJ_WITH_MTL
    from tests.unit.assets.test_compressed import draco_asset, draco_stream, meshopt_asset
    from tests.unit.assets.test_convert import OBJ, PLY, stl
    from tests.unit.assets.test_fuzz import kitchen_sink
    from tests.unit.assets.test_morph import with_targets
    from tests.unit.assets.test_obj_reader import BODY
    from tests.unit.assets.test_replace import DOT, rich

    examples = [(path.name, path.read_bytes()) for path in sorted((ROOT / "examples").glob("*.glb"))[:1]]
    embedded = load_asset(quad())
    made = [
        ("quad.glb", quad()),
        ("rich.glb", rich().glb()),
        ("sink.glb", kitchen_sink()),
        ("targets.glb", with_targets(3).glb()),
        ("morphed.glb", embedded.replace(embedded.surface.positions * 2.0, morph=True)),
        ("meshopt.glb", meshopt_asset().glb()),
        ("draco.glb", draco_asset(draco_stream()).glb()),
        ("data-uris.gltf", _as_gltf(kitchen_sink())),
        ("mesh.obj", OBJ),
        ("mesh.ply", PLY),
        ("mesh.stl", stl()),
        ("body.obj", BODY.encode()),
        ("textured.ply", test_ply_reader.textured("a.png", "b.png", numbers=(1, 0))),
        ("ragged.ply", test_ply_reader.binary("<", [(0, 1, 2), (0, 1, 2, 3)], [(9, 9, 9), (1, 2, 3)])),
        ("big.ply", test_ply_reader.binary(">", [(0, 1, 2), (0, 2, 3)], [(9, 9, 9), (1, 2, 3)])),
        ("magics.stl", test_stl_reader.binary(31, 0x8000, head=b"COLOR=abcd")),
        ("text.stl", b"solid a\n" + test_stl_reader.TEXT * 2 + b"endsolid a\nsolid b\n" + test_stl_reader.TEXT),
        ("colored.3mf", test_formats.threemf(test_formats.COLORED, test_formats.COLORS_3MF)),
        ("levels.glb", test_extensions.levels().glb()),
        ("body.glb", test_extensions.solid({"type": "box", "box": {"size": [2, 2, 2]}}).glb()),
        ("obj.zip", packed({"a.obj": OBJ_WITH_MTL, "lib/things.mtl": MTL, "lib/wood.png": DOT})),
        ("ply.zip", packed({"a.ply": test_ply_reader.textured("a.png"), "A.png": DOT})),
    ]
    return made + examples


def _as_gltf(glb: bytes) -> bytes:
    from tests.unit.assets.builders import unpack

    root, binary, _ = unpack(glb)
    root["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    return json.dumps(root).encode()


_Way = Callable[[random.Random, bytes], bytes]


def mutant(seed: int, number: int, kind: str = "") -> tuple[str, bytes]:
    """Return the damaged file of a seed and a number; with a kind, `ply` for example, of such files alone."""
    chance = random.Random(f"{seed}/{number}")
    name, data = chance.choice([each for each in corpus() if each[0].endswith(kind)])
    ways: list[_Way] = [_flip, _flip, _cut, _lengths, _swap_parts]
    if name.endswith((".obj", ".ply", ".stl")):
        ways += [_words, _words, _words, _repeated]
    if name.endswith((".zip", ".3mf")):
        ways += [_inside] * 10
    if name.endswith((".glb", ".gltf")):
        ways += [_json_values, _json_values, _json_values, _json_values, _payload, _payload]
    if name.endswith(".glb"):
        ways.append(_chunks)
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        try:
            data = chance.choice(ways)(chance, data)[:LARGEST]
        except RecursionError:  # nested too deeply to be parsed again; left as it is
            break
    if chance.random() < 0.02:
        name = chance.choice(["a.obj", "a.ply", "a.stl", "a.gltf", "a.glb", "a", "-x.glb", "\0.obj"])
    return name, data


def _flip(chance: random.Random, data: bytes) -> bytes:
    broken = bytearray(data)
    for _ in range(min(chance.choice([1, 2, 4, 16, 64]), len(broken))):
        at = chance.randrange(len(broken))
        broken[at] = chance.choice([broken[at] ^ 1 << chance.randrange(8), 0, 255, chance.randrange(256)])
    return bytes(broken)


def _words(chance: random.Random, data: bytes) -> bytes:
    """Write words over a text."""
    broken = bytearray(data)
    for _ in range(chance.choice([1, 2, 8])):
        at = chance.randrange(len(broken) + 1)
        broken[at : at + chance.choice([0, 0, 1, 4, 9])] = chance.choice(_WORDS)
    return bytes(broken)


def _repeated(chance: random.Random, data: bytes) -> bytes:
    """Repeat a piece of a text very often."""
    a, b = sorted(chance.randrange(len(data) + 1) for _ in range(2))
    b = min(b, a + chance.choice([1, 2, 20, 500]))
    return data[:b] + data[a:b] * chance.choice([10, 1000, LARGEST // max(b - a, 1)]) + data[b:]


def _inside(chance: random.Random, data: bytes) -> bytes:
    """Damage one of the files in a ZIP, and pack them again."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
    except (zipfile.BadZipFile, zlib.error, OSError, ValueError, EOFError, NotImplementedError, RuntimeError):
        return data
    if files:
        name = chance.choice(list(files))
        files[name] = chance.choice([_flip, _cut, _swap_parts, _words, _repeated])(chance, files[name])[: LARGEST // 2]
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return written.getvalue()


def _cut(chance: random.Random, data: bytes) -> bytes:
    broken = bytearray(data[: chance.randrange(len(data) + 1)])
    if chance.random() < 0.7 and len(broken) >= 12:
        broken[8:12] = struct.pack("<I", len(broken))
    if chance.random() < 0.5 and len(broken) > 28:
        (length,) = struct.unpack("<I", broken[12:16])
        at = 20 + length
        if at + 8 <= len(broken):
            broken[at : at + 4] = struct.pack("<I", len(broken) - at - 8)
    return bytes(broken)


def _lengths(chance: random.Random, data: bytes) -> bytes:
    """Replace four bytes, preferably a length, by an unusual number."""
    if len(data) < 24:
        return data
    broken = bytearray(data)
    at = chance.choice([4, 8, 12, 16, 80, 4 * chance.randrange(len(data) // 4)])
    if at + 4 <= len(data):
        (old,) = struct.unpack("<I", broken[at : at + 4])
        new = chance.choice([0, 1, old + 1, old - 1, 2 * old, 2**31, 2**32 - 1, len(data)])
        broken[at : at + 4] = struct.pack("<I", new % 2**32)
    return bytes(broken)


def _swap_parts(chance: random.Random, data: bytes) -> bytes:
    a, b, c = sorted(chance.randrange(len(data) + 1) for _ in range(3))
    return chance.choice([data[:a] + data[b:c] + data[a:b] + data[c:], data[:b] + data[a:], data[:a] + data[b:]])


def _parts(data: bytes) -> tuple[dict[str, Any], bytes, bytes] | None:
    """Return the JSON, the binary chunk and the rest of a glTF; None if it cannot be parsed."""
    from tests.unit.assets.builders import unpack

    try:
        return unpack(data) if data.startswith(b"glTF") else (dict(json.loads(data)), b"", b"")
    except (ValueError, TypeError, AssertionError, struct.error, RecursionError):
        return None


def _joined(like: bytes, root: Any, binary: bytes, rest: bytes) -> bytes:
    text = json.dumps(root).encode()
    if not like.startswith(b"glTF"):
        return text
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(body) + len(rest)) + body + rest


def _places(value: Any) -> list[tuple[Any, ...]]:
    """Return the paths of all values inside a JSON value, without recursion, which could be too deep."""
    found: list[tuple[Any, ...]] = []
    todo: list[tuple[tuple[Any, ...], Any]] = [((), value)]
    while todo and len(found) < 20_000:
        way, inside = todo.pop()
        items = inside.items() if isinstance(inside, dict) else enumerate(inside) if isinstance(inside, list) else ()
        below = [((*way, key), item) for key, item in items]
        found += [path for path, _ in below]
        todo += reversed(below)
    return found


def _at(root: Any, way: tuple[Any, ...]) -> Any:
    for step in way:
        root = root[step]
    return root


def _json_values(chance: random.Random, data: bytes) -> bytes:
    """Replace, remove, repeat or exchange values of the JSON."""
    parts = _parts(data)
    if parts is None:
        return data
    root, binary, rest = parts
    for _ in range(chance.choice([1, 1, 2, 4])):
        places = _places(root)
        if not places:
            break
        *way, last = chance.choice(places)
        parent = _at(root, tuple(way))
        action = chance.randrange(10)
        if action == 0:
            del parent[last]
        elif action == 1:
            parent[last] = json.loads(json.dumps(_at(root, chance.choice(places))))
        elif action == 2 and isinstance(parent, list):
            parent += json.loads(json.dumps(parent)) * chance.choice([1, 1, 1, 20 if len(data) < 10_000 else 2])
        elif action == 3:
            parent[last] = _nested(chance)
        elif action == 4 and isinstance(parent[last], int):
            parent[last] += chance.choice([-1, 1, 4, -4])
        else:
            parent[last] = _odd(chance, parent[last])
    return _joined(data, root, binary, rest)


def _odd(chance: random.Random, old: Any) -> Any:
    if isinstance(old, int | float) and chance.random() < 0.7:
        return chance.choice([*_NUMBERS, *_FLOATS, *_TYPES])
    one: object = chance.choice([None, True, False, {}, [], chance.choice(_NUMBERS), chance.choice(_FLOATS)])
    texts = chance.choice(_TEXTS)
    return chance.choice([one, texts, [one], {"count": one, "bufferView": 0}, [texts], [0, 1, 2], {"extensions": one}])


def _nested(chance: random.Random) -> Any:
    value: Any = 0
    for _ in range(chance.choice([3, 100, 126, 130, 400])):
        value = chance.choice([[value], {"a": value}, {"extensions": value}])
    return value


def _payload(chance: random.Random, data: bytes) -> bytes:
    """Damage the binary chunk only: indices, sparse rows, Draco and meshopt streams, images."""
    parts = _parts(data)
    if parts is None or not parts[1]:
        return data
    root, binary, rest = parts
    views = root.get("bufferViews")
    span = (0, len(binary))
    if isinstance(views, list) and views:
        view = chance.choice(views)
        body = view if isinstance(view, dict) else {}
        for name in ("extensions", "EXT_meshopt_compression"):
            body = body[name] if isinstance(body.get(name), dict) else body
        start, length = body.get("byteOffset", 0), body.get("byteLength", 0)
        if isinstance(start, int) and isinstance(length, int) and 0 <= start < start + length <= len(binary):
            span = (start, start + length)
    inside = binary[slice(*span)]
    damage = chance.choice([_flip, _flip, _swap_parts])
    changed = damage(chance, inside)[: len(inside)].ljust(len(inside), b"\0")
    if chance.random() < 0.1:
        changed = bytes(chance.choice([0, 1, 127, 255]) for _ in range(1)) * len(inside)
    return _joined(data, root, binary[: span[0]] + changed + binary[span[1] :], rest)


def _chunks(chance: random.Random, data: bytes) -> bytes:
    """Shuffle, repeat, drop and rename the chunks of a GLB."""
    chunks, at = [], 12
    while at + 8 <= len(data):
        (length,) = struct.unpack("<I", data[at : at + 4])
        chunks.append(data[at : at + 8 + length])
        at += 8 + length
    if not chunks:
        return data
    action = chance.randrange(5)
    if action == 0:
        chance.shuffle(chunks)
    elif action == 1:
        again = chance.choice(chunks)
        chunks += [again] * chance.choice([1, 3, 2000 if len(again) < 500 else 2])
    elif action == 2:
        chunks.pop(chance.randrange(len(chunks)))
    elif action == 3:
        at = chance.randrange(len(chunks))
        chunks[at] = chunks[at][:4] + chance.choice([b"JSON", b"BIN\0", b"XTRA", bytes(4)]) + chunks[at][8:]
    else:
        chunks.insert(
            chance.randrange(len(chunks) + 1), struct.pack("<I4s", chance.choice([0, 4, 5]), b"XTRA") + b"abcd"
        )
    body = b"".join(chunks)
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body
