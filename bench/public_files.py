"""Make public GLBs and VRMs taller, and read them again by others: ``python -m bench.public_files FOLDER``.

Every `.glb` and `.vrm` of the folder of at most `--most` bytes gets a change in plain words, `--percent` taller. The
Khronos validator, glTF-Transform and three.js' loader (`npm install --prefix tests/node`) then read it before and
after. A file holds if

* the validator has no issue of the result, by code, that it has not of the file; but the old numbers stay, unused,
  unless it is asked to be `--compact`
* both readers count in it what they count in the file: triangles, bones, targets, textures, clips and others;
  but what was compressed is written as it is
* the box in which three.js draws it is as much taller as was asked
* what it says of an avatar (VRM 0 and 1: bones, expressions, first person, springs, constraints) is what it said, but
  for offsets and radii, which follow the surface
* it can be written in every format of `convert`, which may refuse what the format cannot hold, and the validator finds
  no new issue in the GLB
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.container import Json, glb_layout, parse_json
from meshdeform.assets.export import WRITTEN, export
from meshdeform.errors import MeshdeformError
from meshdeform.requests.document import JobRequest
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input

NODE = Path(__file__).resolve().parents[1] / "tests/node"
NEARLY = 0.01
FOLLOW = {"offset", "tail", "radius", "hitRadius", "offsetFromHeadBone", "firstPersonBoneOffset"}
"""What follows the surface of what a file says of an avatar; all else stays."""
SUFFIXES = {".glb", ".vrm"}
COMPRESSED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"}
UNUSED = "information UNUSED_OBJECT"
SEVERITIES = "error", "warning", "information", "hint"


class Reader:
    """A script of `tests/node` that answers each request with a line of JSON."""

    def __init__(self, script: str) -> None:
        """Start it."""
        command = ["node", str(NODE / script)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def answer(self, request: bytes) -> Any:
        """Send a request, and return the answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(request)
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        """End it."""
        self._process.communicate()


def taller(path: Path, percent: float, *, compact: bool) -> bytes:
    """Return the result of the change."""
    params = {"seed": 0, "guidance": {"kind": "exemplar"}}
    prompt = f"{percent:g}% taller"
    request = JobRequest.model_validate({"prompt": prompt, "params": params, "output": {"compact": compact}})
    run = text_deform.start(job_input(path.read_bytes(), path.name, request))
    for _ in run:
        pass
    return run.finish()["result.glb"].data


def new_issues(validator: Reader, before: bytes, after: bytes, known: str) -> list[str]:
    """Return a sentence for each code but the known one of which the validator finds more after than before."""
    counts: list[Counter[str]] = []
    for glb in (before, after):
        report = validator.answer(len(glb).to_bytes(4, "little") + glb)
        if "failed" in report:
            return [f"validator: {report['failed']}"]
        messages = report["issues"]["messages"]
        counts.append(Counter(f"{SEVERITIES[each['severity']]} {each['code']}" for each in messages))
    return [f"{count} more of {name}" for name, count in (counts[1] - counts[0]).items() if name != known]


def avatar(glb: bytes) -> Json:
    """Return what a file says of an avatar, without what follows the surface: by path, the value."""
    root = parse_json(glb[glb_layout(glb, Limits.unlimited()).json], Limits.unlimited())
    numbered = [(f"{key}/{at}", each) for key in ("nodes", "materials") for at, each in enumerate(root.get(key, []))]
    found: Json = {}
    for where, holder in [("", root), *numbered]:
        for name, body in holder.get("extensions", {}).items():
            if name.startswith("VRM"):
                found |= {f"{where}/{name}{path}": value for path, value in _leaves(body)}
    return found


def _leaves(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the path and value of all but dicts and lists, and of empty ones."""
    parts = list(value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ())
    if not parts:
        yield "", value
    for key, each in parts:
        if key not in FOLLOW:
            yield from ((f"/{key}{path}", leaf) for path, leaf in _leaves(each))


def avatar_changes(before: bytes, after: bytes) -> list[str]:
    """Return a sentence for each thing that is said otherwise of an avatar; what names a copy of a mesh may be new."""
    old, new = avatar(before), avatar(after)
    return [f"{path}: {value!r}, then {new.get(path)!r}" for path, value in old.items() if new.get(path) != value]


def written_ways(path: Path, validator: Reader) -> list[str]:
    """Return a sentence for each format of `convert` in which the file is not written and is not refused."""
    found: list[str] = []
    for ending in WRITTEN:
        try:
            made = export(load_asset(path.read_bytes(), path.name), f"out{ending}").files[f"out{ending}"]
        except MeshdeformError as error:
            if error.status >= 500:
                found.append(f"{ending}: {error}")
            continue
        if ending == ".glb":
            found += new_issues(validator, path.read_bytes(), made, UNUSED)
            found += avatar_changes(path.read_bytes(), made)
    return found


def differences(reader: Reader, name: str, before: Path, after: Path, times: float) -> list[str]:
    """Return a sentence for each thing of which a reader finds other counts, or another box than was asked for."""
    found = reader.answer(json.dumps([str(before), str(after)]).encode() + b"\n")
    if "failed" in found:
        alone = reader.answer(json.dumps([str(before)]).encode() + b"\n")
        return [] if "failed" in alone else [f"{name} does not read the result: {found['failed']}"]
    old, new = found
    if "extensions" in old:
        old["extensions"] = [each for each in old["extensions"] if each not in COMPRESSED]
    different = [f"{name}, {key}: {old[key]}, then {new[key]}" for key in old if key != "box" and old[key] != new[key]]
    if "box" not in old or (None in old["box"][0] and new["box"] == old["box"]):  # not finite: it is not drawn
        return different
    heights = [high[1] - low[1] for low, high in (old["box"], new["box"])]
    ratio = heights[1] / heights[0] if heights[0] else times
    return different if abs(ratio - times) <= NEARLY else [*different, f"{name}: {ratio:.3f} times as tall"]


def main() -> int:
    """Print a line for each file; return 1 if one does not hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--most", type=int, default=2_000_000, metavar="N", help="bytes of a file")
    parser.add_argument("--percent", type=float, default=20.0, help="how much taller")
    parser.add_argument("--compact", action="store_true")
    options = parser.parse_args()
    validator, transform, three = (Reader(name) for name in ("validate.cjs", "transform.mjs", "three.mjs"))
    counts: Counter[str] = Counter()
    for path in sorted(options.folder.rglob("*")):
        if path.suffix.lower() not in SUFFIXES or path.stat().st_size > options.most:
            continue
        kind, said = "holds", []
        try:
            result = taller(path, options.percent, compact=options.compact)
            with tempfile.NamedTemporaryFile(suffix=".glb") as after:
                after.write(result)
                after.flush()
                said = new_issues(validator, path.read_bytes(), result, "" if options.compact else UNUSED)
                said += avatar_changes(path.read_bytes(), result)
                for reader, name in ((transform, "glTF-Transform"), (three, "three.js")):
                    said += differences(reader, name, path, Path(after.name), 1.0 + options.percent / 100.0)
            said += written_ways(path, validator)
            kind = "differs" if said else "holds"
        except MeshdeformError as error:
            kind, said = "refused", [str(error)]
        except Exception as error:  # any error is a result of this file
            traceback.print_exc()
            kind, said = "broken", [f"{type(error).__name__}: {error}"]
        counts[kind] += 1
        print(f"{kind}: {path.relative_to(options.folder)}: {'; '.join(said)}", flush=True)
    for reader in (validator, transform, three):
        reader.close()
    print(", ".join(f"{count} {kind}" for kind, count in counts.items()))
    return int(counts["differs"] + counts["broken"] > 0)


if __name__ == "__main__":
    sys.exit(main())
