"""Create the guidance: a prompt with a prior, a target mesh placed on the asset, or pictures of its outline."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.silhouette import read_silhouette
from meshdeform.deformation.stand_in import stand_in_of
from meshdeform.errors import ParameterError, PromptError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.pictures import SilhouetteView
from meshdeform.geometry.quality import measure_fit
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.geometry.weld import weld
from meshdeform.guidance.alignment import Alignment, aligned, require_overlap, shared_coordinates
from meshdeform.guidance.base import Guidance
from meshdeform.guidance.landmarks import Landmark, diagonal_of, landmark_distances
from meshdeform.guidance.sds import ScoreDistillation, WeightedPrompt
from meshdeform.guidance.silhouettes import BesideSilhouettes, SilhouetteGuidance, SilhouetteTerm
from meshdeform.guidance.target import TargetGuidance
from meshdeform.priors.base import Prior
from meshdeform.rendering.cameras import Frame, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle, Shading
from meshdeform.requests.choices import AlignMode, AppearanceMode, GuidanceKind, is_builtin
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.requests.parameters import SILHOUETTE_PARTS
from meshdeform.requests.selection import Place
from meshdeform.runs.base import InputFile, sha256_hex
from meshdeform.runs.prompts import Prompts
from meshdeform.runs.text_deform_kind import check_places, check_vertex

_SHADINGS: dict[AppearanceMode, Shading] = {
    AppearanceMode.NORMALS: "normals",
    AppearanceMode.CLAY: "lambert",
    AppearanceMode.TEXTURED: "textured",
    AppearanceMode.MIXED: "mixed",
}

_STYLE = RenderStyle(view_size=160, supersample=1)

_COVERED = 0.25
"""Least blue of a covered pixel: normals as colours have at least a half, and the background none."""

_Floats = NDArray[np.float64]


def score_distillation(
    prior: Prior, prompt: str | Sequence[WeightedPrompt], params: ResolvedParams
) -> ScoreDistillation:
    """Return the guidance `sds` of a job with these parameters."""
    return ScoreDistillation(
        prior,
        prompt,
        negative_prompt=params.negative_prompt,
        guidance_scale=params.guidance_scale,
        guidance_rescale=params.guidance_rescale,
        timestep_min=params.timestep_min,
        timestep_max=params.timestep_max,
        timestep_max_end=params.timestep_max_end,
        shading=None if is_builtin(params.model) else _SHADINGS[params.appearance],
    )


@dataclass(frozen=True)
class Goal:
    """Goal of a run."""

    prompt: str  # with which the result is compared; empty for a target, and if each prompt has a region
    guidance: Guidance
    fit: TargetFit | None = None  # the target, placed on the asset
    shares: Sequence[NDArray[np.float64]] = ()
    """sequence of (F,) float64: the faces that each loss of the guidance reaches (`Deformation`)."""


@dataclass(frozen=True)
class GoalSource:
    """Ingredients of a goal."""

    asset: Asset
    world: TriangleMesh  # the asset's welded mesh in its world
    rest: RestMesh  # the mesh from which the run starts, in the cameras' frame
    frame: Frame  # the cameras' frame
    prior: Prior | None  # for a prompt
    target: InputFile | None  # the target mesh
    silhouettes: SilhouetteFit | None  # pictures as targets, alone or beside the prompt
    limits: Limits | None
    device: str
    prompts: Prompts | None = None  # those of a job with `params.guidance.prompts`


def read_goal(request: JobRequest, params: ResolvedParams, job_input: GoalSource) -> Goal:
    """Return the goal of a job."""
    if params.guidance is GuidanceKind.TARGET:
        return _fitted(params, job_input)
    if job_input.prompts is not None:
        pulled = _pictured(job_input.prompts.texts, params, job_input)
        return Goal(job_input.prompts.main, pulled, shares=job_input.prompts.shares)
    return Goal(request.prompt, _pictured(request.prompt, params, job_input))


def _fitted(params: ResolvedParams, job_input: GoalSource) -> Goal:
    file = job_input.target
    if file is None:
        raise ParameterError(
            "params.guidance is `target`, but there is no target mesh.", advice="Send one as the part `target`."
        )
    target = load_asset(file.data, file.filename, job_input.limits)
    fit = TargetFit.of(params, job_input.asset, job_input.world, target, job_input.frame)
    return Goal("", fit.guidance(job_input.rest, params, job_input.device, sha256_hex(file.data)), fit)


def _pictured(prompt: str | Sequence[WeightedPrompt], params: ResolvedParams, job_input: GoalSource) -> Guidance:
    """Return the guidance of prompts, of pictures, or of both."""
    pictures = job_input.silhouettes
    if params.guidance is GuidanceKind.SILHOUETTES and pictures is not None:
        return pictures.guidance(job_input.device)
    guidance = _prompted(prompt, params, job_input.prior)
    return guidance if pictures is None else pictures.beside(guidance, job_input.device)


def _prompted(prompt: str | Sequence[WeightedPrompt], params: ResolvedParams, prior: Prior | None) -> Guidance:
    if not prompt:
        raise PromptError("The prompt is empty.")
    if prior is None:
        raise ParameterError("params.guidance is `sds`, which needs a prior.")
    return score_distillation(prior, prompt, params)


class SilhouetteFit:
    """The pictures of a job.

    `views`: one for each of `params.guidance.silhouettes`; `sha256`: of all pictures.
    """

    def __init__(self, params: ResolvedParams, views: Sequence[SilhouetteView], sha256: str) -> None:
        self._params, self.views, self._sha256 = params, views, sha256

    @classmethod
    def of(cls, params: ResolvedParams, pictures: Sequence[bytes]) -> Self:
        """Read the pictures of a job."""
        if len(pictures) != len(params.silhouettes):
            detail = f"silhouettes has {len(params.silhouettes)} entries, and there are {len(pictures)} pictures."
            raise ParameterError(detail, advice="Give each picture one entry with its azimuth.")
        views = [
            SilhouetteView(read_silhouette(data, f"`{name}`").mask, each.azimuth, each.elevation, each.fov)
            for name, data, each in zip(SILHOUETTE_PARTS, pictures, params.silhouettes, strict=False)
        ]
        return cls(
            params, views, hashlib.sha256(b"".join(hashlib.sha256(data).digest() for data in pictures)).hexdigest()
        )

    def guidance(self, device: str) -> Guidance:
        """Return the guidance by the pictures alone."""
        identity = {"id": "silhouettes", "revision": "", "sha256": self._sha256}
        return SilhouetteGuidance(SilhouetteTerm(self.views, device=device), self._params.silhouette_weight, identity)

    def beside(self, guidance: Guidance, device: str) -> Guidance:
        """Return a guidance by the pictures beside another one."""
        identity = {**guidance.identity, "silhouettes_sha256": self._sha256}
        term = SilhouetteTerm(self.views, device=device)
        return BesideSilhouettes(guidance, term, self._params.silhouette_weight, identity)

    def measure(self, rest: TriangleMesh, verts: _Floats) -> list[dict[str, Any]]:
        """Return `silhouettes` of the report for a result (V, 3) in the cameras' frame."""
        term = SilhouetteTerm(self.views)
        term.begin(rest)
        before, after = (term.overlaps(torch.from_numpy(each)) for each in (rest.verts, verts))
        return [
            {
                "part": name,
                **each.model_dump(mode="json"),
                "iou_before": round(first, 4),
                "iou": round(last, 4),
            }
            for name, each, first, last in zip(SILHOUETTE_PARTS, self._params.silhouettes, before, after, strict=False)
        ]


@dataclass(frozen=True)
class TargetFit:
    """The target of a job, placed on its asset."""

    target: TriangleMesh  # in the cameras' frame
    alignment: Alignment  # from the target file's world to that of the asset
    landmarks: tuple[Landmark, ...]  # in the cameras' frame

    @classmethod
    def of(cls, params: ResolvedParams, asset: Asset, world: TriangleMesh, target: Asset, frame: Frame) -> TargetFit:
        """Align the target with the asset.

        `world`: the asset's welded mesh in its world; `frame`: the cameras' frame.
        """
        surface = target.surface
        goal = weld(surface.positions, surface.triangles).mesh
        check_places(params, {"target": target.summary.bounds})
        landmarks = tuple(
            Landmark(
                _place(pair.source, asset.surface.positions, number, "source"),
                _place(pair.target, surface.positions, number, "target"),
            )
            for number, pair in enumerate(params.landmarks)
        )
        if params.align is AlignMode.AUTO:
            alignment = aligned(goal, world, landmarks)
            advice = "Turn the target so that it is upright as the asset is."
        else:
            alignment = shared_coordinates(goal, world)
            advice = "Set params.guidance.align to auto, or move the target to the asset."
        placed = frame.place(alignment.place_mesh(goal))
        require_overlap(alignment, advice)
        moved = (
            Landmark(_entered(frame, each.source), _entered(frame, alignment.place(each.target[None])[0]))
            for each in landmarks
        )
        return cls(placed, alignment, tuple(moved))

    def guidance(self, rest: TriangleMesh, params: ResolvedParams, device: str, sha256: str) -> TargetGuidance:
        """Return the guidance towards the target for a mesh at rest in the cameras' frame."""
        offset = torch.zeros(3, dtype=torch.float64)
        # Vertices placed by a region or a handle must not be moved afterwards.
        shifts = not (params.regions or params.handles)
        if params.align is not AlignMode.AUTO and shifts:
            # The solve keeps the centre of mass of the asset, so the difference is a translation.
            apart = RestMesh.of(self.target).centre_of_mass() - RestMesh.of(rest).centre_of_mass()
            offset = torch.from_numpy(apart)
        return TargetGuidance(
            stand_in_of(self.target),
            device=device,
            identity={"id": "target", "revision": "", "sha256": sha256},
            point_weight=params.point_weight,
            seed=params.seed,
            landmarks=self.landmarks,
            offset=offset,
            shifts=shifts,
        )

    def measure(self, rest: TriangleMesh, verts: _Floats) -> dict[str, Any]:
        """Return `fit` of the report for a result (V, 3) in the cameras' frame; distances as shares of the diagonal.

        `before` has the same distances of the source.
        """
        result = TriangleMesh(verts, rest.faces)
        measured: dict[str, Any] = {
            **measure_fit(result, self.target).to_dict(),
            "before": measure_fit(rest, self.target).to_dict(),
            "silhouettes": _silhouette_overlap(result, self.target),
            "alignment": self.alignment.to_dict(),
        }
        if self.landmarks:
            reached = landmark_distances(self.landmarks, rest, verts) / diagonal_of(self.target)
            measured["landmarks"] = {"count": len(reached), "mean": float(reached.mean()), "max": float(reached.max())}
        return measured


def _silhouette_overlap(mesh: TriangleMesh, target: TriangleMesh) -> float:
    ours, theirs = _masks(mesh), _masks(target)
    return float((ours & theirs).sum() / max((ours | theirs).sum(), 1))


@torch.no_grad()
def _masks(mesh: TriangleMesh) -> NDArray[np.bool_]:
    """Return the covered pixels (8, S, S) from eight azimuths."""
    renderer = Renderer(faces_of(mesh), len(mesh.verts), _STYLE)
    views = [renderer.render(verts_of(mesh), fixed_cameras(azimuth, 15.0)) for azimuth in (0.0, 45.0)]
    return np.asarray(torch.cat(views)[..., 2].numpy() > _COVERED)


def _place(place: Place, positions: _Floats, number: int, name: str) -> _Floats:
    if not isinstance(place, int):
        return np.array(place, np.float64)
    check_vertex(("guidance", "landmarks", number, name), place, len(positions))
    return np.asarray(positions[place])


def _entered(frame: Frame, point: _Floats) -> _Floats:
    return np.asarray(frame.enter(point[None])[0])
