"""Measure the fit that turns an asset without triangles into the mesh of a `text_deform` job.

python -m bench.fit_source spot.obj --points 20000
"""

from __future__ import annotations

import argparse
import io
import json
import time
from pathlib import Path

import numpy as np

from meshdeform.assets import load_asset
from meshdeform.geometry.samples import even_samples
from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.runs.fitted_source import fitted_source


def cloud(mesh: Path, points: int) -> bytes:
    """Return points of a mesh's surface with the normals of their triangles, as XYZ."""
    surface = load_asset(mesh.read_bytes(), mesh.name).surface
    corners = surface.positions[surface.triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(cross, axis=1)
    face, weights = even_samples(lengths, points, seed=0)
    places = np.einsum("pk,pkc->pc", weights, corners[face])
    out = io.StringIO()
    np.savetxt(out, np.concatenate([places, cross[face] / lengths[face, None]], 1), fmt="%.7f")
    return out.getvalue().encode()


def main() -> None:
    """Print the CPU seconds of the fit, and what the report of a job would say about it, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", type=Path, help="a mesh whose surface is sampled")
    parser.add_argument("--points", type=int, default=20_000)
    options = parser.parse_args()
    data = cloud(options.mesh, options.points)
    given = RunInput(JobRequest(prompt="a measurement"), {"asset": InputFile(data, "cloud.xyz")})
    start = time.process_time()
    found = fitted_source(given)
    assert found is not None
    print(json.dumps({"cpu_s": round(time.process_time() - start, 2), **found.facts}, indent=2))


if __name__ == "__main__":
    main()
