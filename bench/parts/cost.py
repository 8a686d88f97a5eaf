"""Measure what a reading costs, each in a process of its own: ``python -m bench.parts.cost FOLDER``.

An asset of 10,304 faces is read as it is, and one of 20,032 faces split twice into four (320,512). With noun and front
known nothing loads torch; without, the judge is asked before. Memory is the most that the process held, beside what
it held after its imports; `again` is a second reading, when the members of the nouns are drawn.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bench.parts.assets import Listed, files, listed
from meshdeform.assets import load_asset
from meshdeform.plain.body import Body, loose_body

_READ = (("c_man", 0), ("c_taha", 2))
"""Assets, and how often each is split."""


def main() -> None:
    """Print a line for each asset and way."""
    parser = argparse.ArgumentParser(description="Measure what a reading costs.")
    parser.add_argument("folder", type=Path, help="where the files are")
    parser.add_argument("--one", nargs=3, metavar=("NAME", "SPLITS", "WAY"), help="measure in this process")
    asked = parser.parse_args()
    if asked.one:
        name, splits, way = asked.one
        print(json.dumps(_measured(asked.folder, name, int(splits), given=way == "given")))
        return
    for name, splits in _READ:
        for way in ("given", "alone"):
            command = [sys.executable, "-m", "bench.parts.cost", str(asked.folder), "--one", name, str(splits), way]
            told = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            print(
                f"{name} {told['faces']:7} faces {way:5}: {told['seconds']:.2f} s of one core, again "
                f"{told['again']:.2f} s; {told['megabytes']:.0f} MB, {told['at_first']:.0f} of them before",
                flush=True,
            )


def _measured(folder: Path, name: str, splits: int, *, given: bool) -> dict[str, float]:
    """Read an asset twice; `given`: noun and front are."""
    each = listed(names=[name])[0]
    path = files(folder)[each.sha256]
    body = loose_body(load_asset(path.read_bytes(), path.name))
    for _ in range(splits):
        body = _split(body)
    read, at_first, seconds = _reader(each, body, given=given), _megabytes(), []
    for _ in range(2):
        start = time.process_time()
        read()
        seconds.append(time.process_time() - start)
    first, again = seconds
    return {
        "faces": len(body.faces), "seconds": first, "again": again, "megabytes": _megabytes(), "at_first": at_first,
    }  # fmt: skip


def _reader(each: Listed, body: Body, *, given: bool) -> Callable[[], object]:
    """Return what reads a body; what it imports is in memory before it is called."""
    from bench.parts.find import said
    from meshdeform.runs.reading import read_source

    if not given:
        import meshdeform.runs.likeness  # noqa: F401  # with torch
    return lambda: read_source(body, said(each, given=given))


def _megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _split(body: Body) -> Body:
    """Return a body with each face split into four, without joints and names."""
    faces = body.faces
    edges = np.sort(np.stack((faces, np.roll(faces, -1, axis=1)), axis=-1).reshape(-1, 2), axis=1)
    unique, places = np.unique(edges, axis=0, return_inverse=True)
    points = np.concatenate((body.points, body.points[unique].mean(1)))
    middle: NDArray[np.int64] = len(body.points) + places.reshape(-1, 3)
    a, b, c = faces.T
    ab, bc, ca = middle.T
    quarters = np.stack(((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))).transpose(2, 0, 1).reshape(-1, 3)
    every = np.arange(len(points))
    return replace(
        body, points=points, faces=quarters, names={}, joints=(), vertex_map=every, rows=every,
        weights=sparse.csr_matrix((len(points), 0)),
    )  # fmt: skip


if __name__ == "__main__":
    main()
