"""A real deformation, so short that it costs next to nothing."""

from __future__ import annotations

from collections import deque

from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import InputFile

_REQUEST = JobRequest.model_validate(
    {"params": {"guidance": "target", "steps": 2, "learning_rate": 0.05, "seed": 3}, "output": {"morph": True}}
)
_STAGES = JobRequest.model_validate(
    {
        "params": {
            "preset": "preview",
            "steps": 2,
            "stages": [{"target": "target", "name": "ball"}, {"target": "target_2", "name": "flat"}],
        },
        "output": {"morph_path": {"frames": 2}},
    }
)


def deformed(asset: bytes, filename: str = "asset.glb") -> dict[str, bytes]:
    """Run two steps towards a sphere, the whole way of a job, and return its artifacts by name."""
    from meshdeform.runs.text_deform import start

    run = start(asset=asset, filename=filename, request=_REQUEST, target=_sphere(), target_filename="sphere.obj")
    deque(run, maxlen=0)
    return {name: artifact.data for name, artifact in run.finish().items()}


def deformed_in_stages(asset: bytes) -> dict[str, bytes]:
    """Run two stages, towards a sphere and towards a flat one, and return the artifacts by name."""
    from meshdeform.runs.text_deform import start

    targets = {"target": InputFile(_sphere(), "ball.obj"), "target_2": InputFile(_sphere(height=0.5), "flat.obj")}
    run = start(asset=asset, filename="asset.glb", request=_STAGES, targets=targets)
    deque(run, maxlen=0)
    return {name: artifact.data for name, artifact in run.finish().items()}


def _sphere(height: float = 1.0) -> bytes:
    mesh = icosphere(1)
    lines = [f"v {x} {height * y} {z}" for x, y, z in mesh.verts.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    return "\n".join(lines).encode()
