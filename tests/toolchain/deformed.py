"""A real deformation, so short that it costs next to nothing."""

from __future__ import annotations

from collections import deque

from meshdeform.assets import build_glb
from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.document import JobRequest

_REQUEST = JobRequest.model_validate(
    {
        "params": {"steps": 2, "learning_rate": 0.05, "seed": 3, "guidance": {"kind": "target"}},
        "output": {"morph": True},
    }
)


def deformed(asset: bytes, filename: str = "asset.glb") -> dict[str, bytes]:
    """Run two steps towards a sphere, the whole way of a job, and return its artifacts by name."""
    from meshdeform.runs.base import job_input
    from meshdeform.runs.text_deform import start

    mesh = icosphere(1)
    target = build_glb(mesh.verts, mesh.faces)
    run = start(job_input(asset, filename, _REQUEST, target=target))
    deque(run, maxlen=0)
    return {name: artifact.data for name, artifact in run.finish().items()}
