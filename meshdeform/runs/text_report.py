"""Measure the result of a `text_deform` run on its file, read back, and build its report."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import meshdeform
from meshdeform.assets import Asset
from meshdeform.assets.subdivide import MAX_TRIANGLES, Subdivision
from meshdeform.assets.surface import Surface
from meshdeform.deformation.checkpoint import Checkpoint, fingerprint
from meshdeform.deformation.constraints import RigidBody
from meshdeform.deformation.structure import is_convex
from meshdeform.errors import PromptError, VocabularyError
from meshdeform.geometry.congruence import closest_motion
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.quality import MeshQuality, measure
from meshdeform.geometry.texture_stretch import TextureStretch, measure_texture_stretch, texel_corners
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.plain.table import WHOLE
from meshdeform.priors import public_name
from meshdeform.priors.builtin.vocabulary import BUILTIN_WORDS
from meshdeform.requests.choices import AppearanceMode, Rigidity, RigMode, is_builtin
from meshdeform.requests.document import BUILTIN_MODEL, GuidanceKind, ResolvedParams
from meshdeform.requests.parameters import OF_OPTIMISER
from meshdeform.runs.base import RunLog, sha256_hex, versions
from meshdeform.runs.control import control_report
from meshdeform.runs.facts import AssetFacts, GuidedFacts, Held, Outcome
from meshdeform.runs.front import asks_source
from meshdeform.runs.kept_structure import kept_structure
from meshdeform.runs.likeness import likeness, likeness_and_before, prompt_reports
from meshdeform.runs.reading import reading_report
from meshdeform.runs.recognition import Recognition
from meshdeform.runs.starts import Start
from meshdeform.runs.surfaces import Shown
from meshdeform.runs.worth import (
    HELD_BACK,
    UNMOVED,
    ShapeFigures,
    SourceAsset,
    of_noun,
    of_pictures,
    of_prompts,
    of_shape,
    of_target,
    verdict_of_change,
    worst,
)
from meshdeform.vocabulary.grammar import ParsedPrompt, parse

if TYPE_CHECKING:
    from meshdeform.deformation.loop import Deformation
    from meshdeform.plain.change import Done
    from meshdeform.priors.base import Prior
    from meshdeform.reading import Reading
    from meshdeform.runs.goals import Goal

_MOSTLY = 0.5
_REMEDIES = {
    "safeguard": "Set params.safeguard to flips: the surface may then intersect itself. A mesh without doubled or "
    "intersecting surfaces needs no such exception.",
    "guidance": "Use more steps, or a prompt that differs more from the asset.",
}
_CAUSES = {
    "safeguard": "the safeguard held back {held:.0%} of it",
    "guidance": "the guidance hardly pulled at it",
}
_HELD = (
    "The safeguard held back {held:.0%} of the surface in the end, because it would have folded or cut itself: these "
    "parts lag behind. Ask for less (a nearer noun, a lower strength), or for a change of one part in plain words."
)
_PARTS_UNUSED = "params.control.parts was not used: only changes in plain words and `exemplar` know parts."
_BELIEVED = (
    "The asset counts as {noun}, as the prompt describes it, so it was changed and made nothing else. By its shape "
    "that is {probability:.0%} likely: if it is something else, say what by source_noun."
)
_THEN = ", "
_ROUND = "xz"
"""The mirror planes that were kept of what is alike from all sides."""
_NO_COLOURS = "The asset has no colours, so the model saw it as clay."
_COLOURED = (AppearanceMode.TEXTURED, AppearanceMode.MIXED)


@dataclass(frozen=True)
class RunFacts(GuidedFacts):
    """Facts about an optimisation before its first step."""

    start: Start
    goal: Goal
    precision: str | None  # as `precision_of` returns it

    @property
    def guidance(self) -> dict[str, str]:
        """The identity of what guides the run."""
        return dict(self.goal.guidance.identity)

    @property
    def recognised(self) -> Recognition | None:
        """What the source was taken for; None if nothing depends on it."""
        return Recognition.of(self.params, self.reading) if asks_source(self.params) else None


def provenance(facts: AssetFacts, step: int) -> dict[str, Any]:
    """Return the provenance that `output.provenance` stores in a file with the shape of a step."""
    params = facts.params
    weighted = [{"prompt": each.prompt, "weight": each.weight} for each in params.prompts]
    return {
        "version": meshdeform.__version__,
        "prompt": facts.request.prompt,
        **({"prompts": weighted} if weighted else {}),
        "seed": params.seed,
        "guidance": params.guidance.value,
        **({} if params.guidance is GuidanceKind.EXEMPLAR else {"preset": params.preset.value, "step": step}),
        "parameters_sha256": fingerprint(**params.model_dump(mode="json")),
        "source_sha256": facts.file.sha256,
    }


def build_report(facts: RunFacts, deformation: Deformation, outcome: Outcome, first_step: int, log: RunLog) -> bytes:
    """Return `report.json`.

    `deformation`: after its last step; `first_step`: number of steps done by earlier attempts.
    """
    params, asset = facts.params, facts.asset
    with log.phase("measure"):
        measured = measured_result(facts, outcome)
        movement = measure_movement(RestMesh.of(facts.welded.mesh), outcome.verts, outcome.held)
        compared = _comparisons(facts, deformation, outcome, measured.quality.to_dict(), movement)
    report = {
        **common_members(facts, outcome, measured),
        "way": "prompt",
        "guidance": facts.guidance | {"id": public_name(facts.guidance["id"])},
        "fingerprint": facts.fingerprint,
        "precision": facts.precision,
        "carrier": deformation.carrier,
        "start": facts.start.told,
        "source_noun": None if facts.recognised is None else facts.recognised.to_dict(),
        "reading": reading_report(facts.reading, params),
        "orientation": deformation.orientation.to_dict(),
        "appearance": _appearance(params, deformation),
        "movement": movement.to_dict(),
        "pulls": deformation.pulls.to_dict(),
        "warnings": [
            *_read_otherwise(facts),
            *movement.warnings,
            *deformation.warnings,
            *deformation.pulls.warnings,
            *measured.warnings(facts),
            *rig_warnings(asset, facts.request.output.rig),
            *_precision_warnings(facts.precision),
            *([_PARTS_UNUSED] if params.parts and facts.start.told is None else []),
        ],
        "losses": log.losses(),
        "resumed_from_step": first_step,
        "seconds": {name: round(seconds, 4) for name, seconds in log.seconds.items()},
    }
    report["mesh"] |= {"optimized_faces": deformation.optimized_faces}
    return guided_report(report, facts, outcome.written, compared)


def guided_report(report: dict[str, Any], facts: GuidedFacts, written: Asset, compared: Mapping[str, Any]) -> bytes:
    """Return `report.json`: its members, what became of the rig, the rigid parts and the controls, and comparisons.

    `written`: `result.glb`, read back.
    """
    params, asset = facts.params, facts.asset
    if asset.rig():
        report["rig"] = {"mode": facts.request.output.rig.value, **asdict(asset.rig())}
    if facts.control.bodies:
        report["rigid"] = kept_shapes(facts.control.bodies, asset, facts.welded, written)
    report |= control_report(facts.control, params, facts.welded, facts.frame, asset, written)
    return json.dumps(report | dict(compared), indent=2, allow_nan=False, default=str).encode()


def change_report(
    facts: AssetFacts,
    done: Sequence[Done],
    notes: Sequence[str],
    reading: Reading | None,
    *,
    described: bool,
    mode: RigMode,
    outcome: Outcome,
    log: RunLog,
) -> bytes:
    """Return `report.json` of a change in plain words.

    `notes`: how misspelt words were read; `reading`: what the source was read as, if that was needed; `described`:
    whether the prompt describes it as that; `mode`: what became of the rig.
    """
    of_parts = all(each.change.part != WHOLE for each in done)
    with log.phase("measure"):
        measured = measured_result(facts, outcome)
        source, result = outcome.shown.source, outcome.shown.result
        structure = kept_structure(source, result, measured.quality.to_dict(), of_parts=of_parts)
    known = Recognition.of(facts.params, reading)
    doubted = described and not known.likely
    taken = [_BELIEVED.format(noun=ParsedPrompt(known.noun), probability=known.probability)] if doubted else []
    rig = facts.asset.rig()
    nothing = dict.fromkeys(("guidance", "carrier", "orientation", "appearance", "likeness", "prompts"))
    report = {
        **common_members(facts, outcome, measured),
        **nothing,
        "way": "change",
        "changes": [each.to_dict() for each in done],
        "verdict": verdict_of_change(
            structure,
            [*taken, *(doubt for each in done for doubt in each.doubts)],
            of_parts=of_parts,
        ),
        "fingerprint": fingerprint(prompt=facts.request.prompt, asset=facts.file.sha256 or ""),
        "source_noun": {**known.to_dict(), "recognised": True} if described else None,
        "reading": reading_report(reading, facts.params),
        "warnings": [
            *notes,
            *taken,
            *(sentence for each in done for sentence in each.warnings),
            *measured.warnings(facts),
            *rig_warnings(facts.asset, mode),
        ],
        "losses": [],
        "resumed_from_step": 0,
        "seconds": {name: round(seconds, 4) for name, seconds in log.seconds.items()},
    }
    if rig:
        report["rig"] = {"mode": mode.value, **asdict(rig)}
    return json.dumps(report, indent=2, allow_nan=False, default=str).encode()


@dataclass(frozen=True)
class Measured:
    """The quality of a result, and how far it stretched textures."""

    quality: MeshQuality
    stretch: TextureStretch | None
    left_out: dict[str, int]

    def warnings(self, facts: AssetFacts) -> list[str]:
        """Return the sentences about damage, and about what was split."""
        return [
            *self.quality.warnings(len(facts.welded.mesh.faces)),
            *_stayed_warnings(facts.asset.surface),
            *_subdivision_warnings(facts.subdivision),
        ]


def measured_result(facts: AssetFacts, outcome: Outcome) -> Measured:
    """Measure a result beside its source."""
    source = facts.welded.mesh
    quality = measure(source.verts, source.faces, outcome.shown.result.verts)
    look = facts.asset.appearance().of_triangles(facts.drawn)
    triangles = facts.asset.surface.triangles[facts.drawn]
    corners = (shape.surface.positions[triangles] for shape in (facts.asset, outcome.written))
    return Measured(quality, measure_texture_stretch(texel_corners(look), *corners), look.left_out)


def _told_params(params: ResolvedParams) -> dict[str, Any]:
    """Return the parameters that a run has: a fit has none of the optimiser's."""
    unused = OF_OPTIMISER | {"preset"} if params.guidance is GuidanceKind.EXEMPLAR else frozenset()
    # Clients read the report: a model in a folder is named as the service names it.
    return params.model_dump(mode="json", exclude=set(unused)) | {"model": public_name(params.model)}


def common_members(facts: AssetFacts, outcome: Outcome, measured: Measured) -> dict[str, Any]:
    """Return the members that a report has whatever moved the asset."""
    request, asset = facts.request, facts.asset
    report: dict[str, Any] = {
        "kind": request.kind.value,
        "prompt": request.prompt,
        "params": _told_params(facts.params),
        "seed": facts.params.seed,
        "metadata": request.metadata,
        "input": {
            "filename": facts.file.filename,
            "bytes": len(facts.file.data),
            "sha256": facts.file.sha256,
            "warnings": list(asset.summary.warnings),
            "polygons": asset.polygons(),
        },
        "device": facts.device,
        "versions": versions(),
        "result": {"bytes": len(outcome.result), "sha256": sha256_hex(outcome.result)},
        "mesh": _mesh_figures(facts, outcome),
        "quality": measured.quality.to_dict(),
        "texture_stretch": None if measured.stretch is None else measured.stretch.to_dict(),
        "skipped": {
            **facts.welded.skipped,
            "fixed_vertices": int(asset.surface.stays.sum()),
            "primitives": asset.surface.skipped,
        },
    }
    if facts.subdivision is not None:
        report["subdivision"] = asdict(facts.subdivision)
    if measured.left_out:
        report["preview"] = {"left_out": measured.left_out}
    return report


def _comparisons(
    facts: RunFacts, deformation: Deformation, outcome: Outcome, quality: dict[str, Any], movement: Movement
) -> dict[str, Any]:
    """Return the members of the report that compare the result with what was asked for, and say what it is worth."""
    goal, shown = facts.goal, outcome.shown
    structure = kept_structure(shown.source, shown.result, quality)
    shape = ShapeFigures.of(structure, quality, movement.to_dict(), fitted=not goal.prompt and facts.prompts is None)
    if facts.start.told is not None:  # its parts have the proportions of those of the exemplar
        shape = replace(shape, swollen=False)
    compared: dict[str, Any] = {}
    verdicts = []
    if goal.prompt and _is_judged(facts, goal.prompt):
        comparison = likeness_and_before(shown.source, shown.result, goal.prompt)
        if comparison is not None:
            compared["likeness"] = comparison
    if goal.fit is not None or facts.silhouettes is not None:
        in_frame = facts.frame.place(facts.welded.mesh), facts.frame.enter(outcome.verts)
        if goal.fit is not None:
            compared["fit"] = goal.fit.measure(*in_frame)
            verdicts.append(of_target(compared["fit"], shape))
        if facts.silhouettes is not None:
            compared["silhouettes"] = facts.silhouettes.measure(*in_frame)
            verdicts.append(of_pictures(compared["silhouettes"], shape))
    if facts.prompts is not None:  # none alone is what the result should be
        judge = likeness if facts.guidance["id"] == BUILTIN_MODEL else None
        compared["prompts"] = prompt_reports(facts.prompts, shown.source, shown.result, judge)
        verdicts.append(of_prompts(compared["prompts"], shape))
    elif "likeness" in compared:
        verdicts.append(of_noun(goal.prompt, compared["likeness"], shape, _known_source(facts, deformation, shown)))
    elif goal.prompt:
        verdicts.append(of_shape(shape))
    return {**compared, "verdict": worst(verdicts)}


def _read_otherwise(facts: RunFacts) -> Sequence[str]:
    """Return which word of the prompt of the builtin prior means its noun and is not its name."""
    if not facts.request.prompt or facts.guidance["id"] != BUILTIN_MODEL:
        return ()
    return parse(facts.request.prompt, BUILTIN_WORDS).notes


def _is_judged(facts: RunFacts, prompt: str) -> bool:
    """Return whether the judge knows the noun of a prompt: not that of other weights, nor of free text."""
    if is_builtin(facts.params.model) and facts.guidance["id"] != BUILTIN_MODEL:
        return False
    try:
        parse(prompt)
    except (PromptError, VocabularyError):
        return False
    return True


def _known_source(facts: RunFacts, deformation: Deformation, shown: Shown) -> SourceAsset:
    """Return what is known of the source of a prompt."""
    known = facts.recognised
    return source_of(
        shown,
        noun="" if known is None else known.noun,
        sure=known is None or known.sure,
        round=deformation.carrier.get("mirror") == _ROUND,
    )


def source_of(shown: Shown, **known: Any) -> SourceAsset:
    """Return what is known of a source, beside what its surface and that of the result tell."""
    sizes = [np.ptp(each.verts, axis=0) for each in (shown.source, shown.result)]
    before, after = (np.maximum(size, max(float(size.max()), 1e-12) * 1e-3) for size in sizes)
    x, y, z = (float(factor) for factor in after / before)
    long_axis = 0 if before[0] >= before[2] else 2
    return SourceAsset(growth=(x, y, z), long_axis=long_axis, convex=is_convex(RestMesh.of(shown.source)), **known)


def _mesh_figures(facts: AssetFacts, outcome: Outcome) -> dict[str, Any]:
    """Return counts of the mesh, and whether the file has the same vertices, faces and UVs."""
    asset, source, result = facts.asset, facts.asset.surface, outcome.written.surface
    return {
        "source_vertices": len(source.positions),
        "source_triangles": len(source.triangles),
        "welded_vertices": facts.welded.mesh.verts.shape[0],
        "welded_faces": facts.welded.mesh.faces.shape[0],
        "rebuilt_normals": outcome.rebuilt_normals + asset.repairs.normals,
        "rebuilt_tangents": asset.repairs.tangents,
        "same_vertex_count": len(source.positions) == len(result.positions),
        "same_faces": bool(np.array_equal(source.triangles, result.triangles)),
        "same_uvs": asset.texture_coordinates() == outcome.written.texture_coordinates(),
    }


@dataclass(frozen=True)
class Movement:
    """How far a run moved its mesh."""

    rms: float  # area-weighted root mean square displacement, as a share of the diagonal of the source's bounding box
    held_share: float
    """Mean share of the faces, or of the cells of a lattice, that the safeguard held back when it checked."""
    held_at_end: float  # that of the last quarter of the run
    stalled_by: str | None
    """The cause that mostly held back a mesh that hardly moved: `safeguard` or `guidance`; None if it moved."""

    def to_dict(self) -> dict[str, float | str | None]:
        """Return the figures by name."""
        return asdict(self)

    @property
    def warnings(self) -> list[str]:
        """Sentences for the user: what held the mesh back, and what to do; empty if nothing did."""
        if self.stalled_by is None:
            return [_HELD.format(held=self.held_at_end)] if self.held_at_end > HELD_BACK else []
        cause = _CAUSES[self.stalled_by].format(held=self.held_share)
        return [f"The mesh hardly moved ({self.rms:.1%} of its size): {cause}. {_REMEDIES[self.stalled_by]}"]


def measure_movement(rest: RestMesh, verts: NDArray[np.float64], held: Held) -> Movement:
    """Compare a deformed mesh with its rest state.

    `verts`, (V, 3) float64: deformed positions in the same unit.
    """
    weights = rest.vertex_areas
    used = rest.verts[np.unique(rest.faces)]
    diagonal = float(np.linalg.norm(np.ptp(used, axis=0))) if len(used) else 0.0
    squared = ((verts - rest.verts) ** 2).sum(1)
    total = float(weights.sum())
    rms = float(np.sqrt((weights * squared).sum() / total)) / diagonal if total > 0 and diagonal > 0 else 0.0
    stalled_by = None
    if rms < UNMOVED:
        stalled_by = "safeguard" if held.mean > _MOSTLY else "guidance"
    return Movement(rms, held.mean, held.at_end, stalled_by)


def _stayed_warnings(surface: Surface) -> list[str]:
    """Return a sentence about vertices that could not be moved where viewers show them, if there are any."""
    count = int(surface.stays.sum())
    if not count:
        return []
    return [
        f"{count:,} of {len(surface.stays):,} vertices stayed as they were: the joints that they follow flatten them, "
        "so that what was changed cannot be taken back to the file. Export the asset in another pose."
    ]


def kept_shapes(bodies: Sequence[RigidBody], source: Asset, welded: WeldedMesh, result: Asset) -> dict[str, Any]:
    """Return how exactly the bodies kept their shape in the file, as a share of the source's diagonal."""
    before, after = source.surface.positions, result.surface.positions
    diagonal = float(np.linalg.norm(np.ptp(welded.mesh.verts, axis=0)))
    owner = np.full(len(welded.mesh.verts) + 1, -1)  # the last one is for unused source vertices
    for number, body in enumerate(bodies):
        owner[body.verts] = number
    rows = np.flatnonzero(owner[welded.vertex_map] >= 0)
    rows = rows[np.argsort(owner[welded.vertex_map[rows]], kind="stable")]
    sizes = np.bincount(owner[welded.vertex_map[rows]], minlength=len(bodies))
    worst = max(
        closest_motion(before[chosen], after[chosen], scaled=body.mode is Rigidity.SIMILARITY).max_distance
        for body, chosen in zip(bodies, np.split(rows, np.cumsum(sizes)[:-1]), strict=True)
    )
    return {
        "bodies": len(bodies),
        "vertices": sum(len(body.verts) for body in bodies),
        "max_deviation": worst / diagonal,
    }


def rig_warnings(asset: Asset, mode: RigMode) -> list[str]:
    """Return a sentence about what of a file did not follow its shape, if there is anything."""
    if mode is RigMode.FOLLOW:
        return []
    rig, turned = asset.rig(), asset.turned_nodes()
    counted = [(rig.joints, "joint"), (rig.morph_targets, "morph target"), (len(turned), "animated node")]
    what = " and ".join(f"{count} {name}{'s' if count > 1 else ''}" for count, name in counted if count)
    if not what:
        return []
    return [
        f"The asset has {what}, which stayed as they were, as output.rig asks: animations may distort the new shape. "
        "Let them follow, so that the result animates as the source does."
    ]


def precision_of(prior: Prior | None, state: Checkpoint | None = None) -> str | None:
    """Return the precision of a run, such as `float32`; None without a prior.

    Where the run resumes at a state that was computed in another precision, both are named, in order.
    """
    if prior is None:
        return None
    now, before = str(prior.dtype).removeprefix("torch."), state.precision if state else ""
    if not before:
        return now
    return before if before.split(_THEN)[-1] == now else f"{before}{_THEN}{now}"


def _precision_warnings(precision: str | None) -> list[str]:
    """Return a warning of a run that was resumed in another precision."""
    if precision is None or _THEN not in precision:
        return []
    return [
        f"The run was resumed in another precision: the model computed in {precision}, in this order. "
        "On one machine the same job gives a slightly different result."
    ]


def _subdivision_warnings(done: Subdivision | None) -> list[str]:
    """Return sentences about what subdivision changed, or could not."""
    if done is None:
        return []
    if not done.split and not done.limited:
        return ["output.subdivide changed nothing: no edge is longer than a tenth of the asset."]
    warnings = []
    if done.split:
        warnings.append(
            f"output.subdivide split long edges: {done.triangles_before:,} triangles became "
            f"{done.triangles_after:,}. Vertices and faces of the result are not those of the source file."
        )
    if done.limited:
        warnings.append(
            f"output.subdivide stopped before it would exceed {MAX_TRIANGLES:,} triangles or the limit of this "
            f"deployment. The longest edge has {done.longest_edge:.0%} of the asset's length."
        )
    if done.dropped:
        warnings.append(f"output.subdivide removed {', '.join(done.dropped)}, which lists edges of the source.")
    return warnings


def sees_colours(params: ResolvedParams) -> bool:
    """Return whether the guidance is to see the asset's colours."""
    return params.guidance is GuidanceKind.SDS and params.appearance in _COLOURED


def _appearance(params: ResolvedParams, deformation: Deformation) -> dict[str, Any]:
    """Return the report's `appearance`: what was `drawn`, where the `colours` come from, and a `notice`."""
    # `colours` is `asset`; `stand_in` if a simplified mesh was drawn with vertex colours sampled from the asset; or
    # None.
    colours_seen = sees_colours(params)
    coloured = colours_seen and deformation.shading != "lambert"
    return {
        "drawn": (AppearanceMode.CLAY if colours_seen and not coloured else params.appearance).value,
        "colours": ("stand_in" if deformation.simplified else "asset") if coloured else None,
        "notice": _NO_COLOURS if colours_seen and not coloured else "",
    }
