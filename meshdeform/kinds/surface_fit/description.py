"""Describe the kind `surface_fit`: its files, the check of its requests, and its artifacts. Torch-free."""

from __future__ import annotations

from pathlib import PurePath

from meshdeform.errors import ParameterError
from meshdeform.kinds.surface_fit.params import MAX_BASE_FACES, MAX_LEVEL, SurfaceFitParams
from meshdeform.requests.document import JobKind, JobRequest
from meshdeform.runs.base import ArtifactKind, FileField, Kind, params_of, start_of
from meshdeform.runs.costs import Costs

COSTS = {"surface_fit/": Costs(1.73, 6.0, 0.0078)}
"""As in `meshdeform.runs.costs`."""

_GLB = "model/gltf-binary"
_SAME = ("base_faces", "features", "octaves", "width", "depth")


def _as_branch(job: JobRequest, branch: JobRequest) -> JobRequest:
    """Return the branch's request with the base and the network of its job, whose weights it starts with."""
    requested, own = params_of(job, SurfaceFitParams), params_of(branch, SurfaceFitParams)
    for name in _SAME:
        if name in own.model_fields_set and getattr(own, name) != getattr(requested, name):
            raise ParameterError.at(
                ["params", name],
                f"A branch starts with the weights of its job, so it needs the same params.{name}.",
                f"Leave params.{name} out, or post a new job.",
                message="differs from that of the job",
            )
    params = own.model_copy(update={name: getattr(requested, name) for name in _SAME})
    return branch.model_copy(update={"params": params})


SURFACE_FIT = Kind(
    name=JobKind("surface_fit"),
    summary="Fits a coarse mesh and a small network to a surface, as a file of a few kilobytes.",
    reads=(
        FileField(
            "asset",
            "The surface: a mesh (GLB, OBJ, PLY, STL, ZIP), oriented points (PLY, XYZ), a signed distance grid (NPZ) "
            "or a network (safetensors).",
            required=True,
            media_types=(_GLB, "model/obj", "model/ply", "model/stl", "application/zip", "application/octet-stream"),
            content="surface",
        ),
        FileField(
            "base",
            f"A base mesh of its own, of at most {MAX_BASE_FACES} faces, instead of one made from the surface.",
            required=False,
            media_types=(_GLB, "model/obj", "model/ply", "model/stl", "application/zip"),
        ),
        FileField(
            "scalars",
            "Values at points near the surface, an NPZ, that are learned along it and kept in `surface.ndf`.",
            required=False,
            media_types=("application/octet-stream",),
            content="scalars",
        ),
    ),
    params=SurfaceFitParams,
    check=lambda request, _settings, _files: params_of(request, SurfaceFitParams),
    steps=lambda request, _model, kept: params_of(request, SurfaceFitParams, kept).steps,
    load=start_of("meshdeform.kinds.surface_fit.run"),
    artifacts=(
        ArtifactKind("surface.ndf", "application/octet-stream", "The field: base mesh and network."),
        *(
            ArtifactKind(
                f"level_{k}.glb",
                _GLB,
                "The base mesh."
                if k == 0
                else f"The surface with {4**k} triangles per face of the base"
                + (", if `params.level` is as high." if k > 0 else "."),
            )
            for k in range(MAX_LEVEL + 1)
        ),
        ArtifactKind(
            "intrinsic.npz",
            "application/octet-stream",
            "Faces, edge lengths and vertices of the highest level after intrinsic Delaunay flips.",
        ),
        ArtifactKind(
            "report.json",
            "application/json",
            "Parameters, bytes, distances both ways, normals, eigenvalues and geodesics against the input.",
        ),
        ArtifactKind("preview.png", "image/png", "The input and the highest level, from four sides."),
    ),
    as_branch=_as_branch,
    goal=lambda _request, names: f"field of {PurePath(names['asset']).stem}" if "asset" in names else "field",
)

KINDS = (SURFACE_FIT,)
