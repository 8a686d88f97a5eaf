"""Measure what a run costs by the number of faces: ``python -m bench.keep.cost [NAME=CHECKOUT ...] [--kind exemplar]``.

A member of the family of dogs is split and simplified to each number of faces, and run as `meshdeform run` does towards
"a horse", each in a process of its own, by every checkout in turn, so that all are measured on one machine in one go.
Seconds are of the CPU and of the whole process, with the start of Python; memory is the most that it held.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from bench.keep.runs import KINDS, ROOT, Code, measured
from meshdeform.nouns.labels import labelled_member

_FACES = (1_000, 10_000, 100_000, 300_000)
_PROMPT = "a horse"


def main() -> None:
    """Print a line for each number of faces and checkout."""
    parser = argparse.ArgumentParser(description="Measure what a run costs by the number of faces.")
    parser.add_argument("checkouts", nargs="*", metavar="NAME=CHECKOUT", help="other checkouts to measure beside this")
    parser.add_argument("--kind", choices=KINDS, help="guidance.kind of this checkout's runs")
    parser.add_argument("--faces", type=int, nargs="+", default=list(_FACES))
    asked = parser.parse_args()
    others = dict(each.split("=", 1) for each in asked.checkouts)
    runs = [(name, Code.of(Path(folder).resolve()), None) for name, folder in others.items()]
    runs.append(("this", Code.of(ROOT), asked.kind))
    with tempfile.TemporaryDirectory() as folder:
        # The first run of a checkout compiles what later ones load.
        write_dog(first := Path(folder, "first.obj"), _FACES[0])
        for _, code, kind in runs:
            measured(_PROMPT, first, Path(folder), code, kind)
        for faces in asked.faces:
            path = Path(folder, f"dog{faces}.obj")
            count = write_dog(path, faces)
            for name, code, kind in runs:
                told = measured(_PROMPT, path, Path(folder), code, kind)
                said = told["problem"] or f"{told['cpu_seconds']:6.1f} CPU s  {told['megabytes']:5} MB"
                print(f"{count:7} faces  {name:10} {code.commit}  {said}", flush=True)


def write_dog(path: Path, faces: int) -> int:
    """Write a member of the family of dogs as OBJ, of about so many faces; return how many it has."""
    member = labelled_member("dog", (), np.random.default_rng(1))
    verts, corners = member.verts, member.faces
    while len(corners) < faces:
        verts, corners = split(verts, corners)
    verts, corners = fast_simplification.simplify(
        verts.astype(np.float32), corners.astype(np.int32), 1 - faces / len(corners)
    )
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in verts]
    lines += [f"f {a} {b} {c}" for a, b, c in np.asarray(corners) + 1]
    path.write_text("\n".join(lines) + "\n")
    return len(corners)


def split(verts: NDArray[np.float64], faces: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices and faces with each face split into four at the middles of its edges."""
    edges = np.sort(np.stack((faces, np.roll(faces, -1, axis=1)), axis=-1).reshape(-1, 2), axis=1)
    unique, places = np.unique(edges, axis=0, return_inverse=True)
    a, b, c = faces.T
    ab, bc, ca = (len(verts) + places.reshape(-1, 3)).T
    quarters = np.stack(((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))).transpose(2, 0, 1).reshape(-1, 3)
    return np.concatenate((verts, verts[unique].mean(1))), quarters


if __name__ == "__main__":
    main()
