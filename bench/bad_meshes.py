"""Send bad meshes through every way of a job: ``python -m bench.bad_meshes [--only NAME] [--way WAY] [--size N]``.

47 kinds (`BAD` of `bench/input_meshes.py`): needles, duplicate and opposite faces, fans, islands of one triangle,
T-junctions and others, each through changes in plain words, a word, a target and a field. Prints a line of each as it
is done, and fails if one does not hold. A way holds if

* the mesh is not refused, since a viewer shows it; a sentence that asks for a part which it has not may be
* no face is flipped that was not; of a field, whose faces are its own, none counts
* what was closed stays closed: vertices at one place stay at one, and T-junctions on their edges
"""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bench.input_meshes import BAD, Input
from bench.inputs import glb
from meshdeform.assets import build_glb, load_asset
from meshdeform.geometry.junctions import opened
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.weld import WeldedMesh, weld
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run, text_deform
from meshdeform.runs.base import job_input

__all__ = ["WAYS", "problems", "torn"]

_Floats = NDArray[np.float64]
_APART = 1e-6
"""Distance, as a share of the diagonal, from which vertices at one place have come apart."""
_FIT = {"steps": 20, "level": 1}


def _text(prompt: str, *, target: bytes | None = None) -> Callable[[bytes], bytes]:
    def way(asset: bytes) -> bytes:
        request = JobRequest.model_validate({"prompt": prompt, "params": {"seed": 0, "guidance": {"kind": "exemplar"}}})
        run = text_deform.start(job_input(asset, "input", request, target=target))
        for _ in run:
            pass
        return run.finish()["result.glb"].data

    return way


def _field(asset: bytes) -> bytes:
    request = JobRequest.model_validate({"kind": "surface_fit", "params": _FIT})
    run = start_run(job_input(asset, "input.glb", request))
    for _ in run:
        pass
    return run.finish()[f"level_{_FIT['level']}.glb"].data


def _ball() -> bytes:
    ball = icosphere(3)
    return build_glb(ball.verts, ball.faces)


WAYS: dict[str, Callable[[bytes], bytes]] = {
    "taller": _text("twice as tall"),
    "fatter": _text("fatter"),
    "twisted": _text("twisted"),
    "word": _text("a vase"),
    "target": _text("", target=_ball()),
    "field": _field,
}


def problems(made: Input, way: str) -> list[str]:
    """Return what is wrong with a mesh that went a way; nothing if it holds."""
    asset = glb(made)
    result = WAYS[way](asset)
    old, new = load_asset(asset).surface, load_asset(result).surface
    if not np.isfinite(new.positions).all():
        return ["positions that are not finite"]
    if way == "field":
        return []
    if not np.array_equal(old.triangles, new.triangles):
        return ["other faces"]
    welded = weld(old.positions, old.triangles)
    mesh, after = welded.mesh, welded.gather(new.positions)
    found = torn(old.positions, new.positions, welded, after.verts)
    flipped = measure(mesh.verts, mesh.faces, after.verts).flipped_faces
    return [*found, *([f"{flipped} faces flipped"] if flipped else [])]


def torn(old: _Floats, new: _Floats, welded: WeldedMesh, verts: _Floats) -> list[str]:
    """Return what has come apart: of vertices (N, 3) before and after, which are welded to others (V, 3)."""
    rest, used = welded.mesh, welded.vertex_map >= 0
    diagonal = float(np.linalg.norm(np.ptp(new, axis=0)))
    beside = (new - old)[used] - (verts - rest.verts)[welded.vertex_map[used]]
    apart = int((np.linalg.norm(beside, axis=1) > _APART * diagonal).sum())
    junctions = opened(rest.verts, rest.faces, verts) or 0
    named = ((apart, "vertices came apart"), (junctions, "T-junctions opened"))
    return [f"{count} {what}" for count, what in named if count]


def main() -> int:
    """Print what holds and what does not; return 1 if anything does not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=list(BAD), help="a mesh; may be repeated")
    parser.add_argument("--way", action="append", choices=list(WAYS), help="a way; may be repeated")
    parser.add_argument("--size", type=float, default=1.0, help="less than 1 for coarser meshes")
    options = parser.parse_args()
    names, ways = options.only or list(BAD), options.way or list(WAYS)
    failed = 0
    print("| mesh | what is bad | way | result |\n|---|---|---|---|")
    for name in names:
        made = BAD[name](options.size)
        for way in ways:
            try:
                found = problems(made, way)
            except Exception as error:  # any error is a result of this mesh
                traceback.print_exc()
                found = [f"{type(error).__name__}: {error}"]
            failed += bool(found)
            print(f"| `{name}` | {made.special} | {way} | {'; '.join(found) or 'holds'} |", flush=True)
    print(
        f"\n{len(names) * len(ways) - failed} of {len(names) * len(ways)} hold: {len(names)} meshes, {len(ways)} ways"
    )
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
