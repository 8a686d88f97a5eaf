"""Run a tiny job, so that the first real one in a process does not wait for what every job loads.

``python -m meshdeform.runs.rehearsal`` runs several, which compiles their kernels into numba's cache: the workers'
image does this when it is built.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from meshdeform.assets.build import build_glb
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.priors import load_prior
from meshdeform.requests.document import BUILTIN_MODEL, JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import job_input

if TYPE_CHECKING:
    from meshdeform.runs.base import JobRun

_PROMPT = "a mushroom"
_CHANGE = "twice as tall"


def rehearse() -> None:
    """Fit a small sphere, and make no result: that needs no torch, which the first job of an optimiser imports."""
    _run(_glb(1), {"prompt": _PROMPT, "params": {"guidance": {"kind": "exemplar"}}})


def main() -> None:
    """Also do what only some jobs do: fit a target or a surface, carry parts, walk a morph's path, change by words."""
    prior = load_prior(BUILTIN_MODEL, device="cpu")
    for glb in (_glb(1), _glb(2)):
        _run(
            glb,
            {"prompt": _PROMPT, "params": {"guidance": {"kind": "sds"}}, "output": {"morph": True}},
            prior=prior,
        ).finish()
        _run(glb, {"params": {"guidance": {"kind": "target"}}}, target=_glb(1), target_filename="sphere.glb").finish()
        _run(glb, {"prompt": _PROMPT, "params": {"guidance": {"kind": "exemplar"}}}).finish()
    _run(_glb(1), {"prompt": _CHANGE, "params": {"guidance": {"kind": "exemplar"}}}).finish()
    _run(_glb(1), {"kind": "surface_fit", "params": {"base_faces": 100, "steps": 2, "level": 0}}).finish()


def _glb(components: int) -> bytes:
    sphere = icosphere(2)
    mesh = join(*(replace(sphere, verts=sphere.verts + 3.0 * number) for number in range(components)))
    return build_glb(mesh.verts, mesh.faces)


def _run(glb: bytes, document: dict[str, Any], **files: Any) -> JobRun:
    if document["params"].get("guidance", {}).get("kind") in ("sds", "target"):
        document["params"] |= {"preset": "preview", "steps": 2}
    request = JobRequest.model_validate(document)
    run = start_run(job_input(asset=glb, filename="sphere.glb", request=request, **files))
    for _ in run:
        pass
    return run


if __name__ == "__main__":
    main()
