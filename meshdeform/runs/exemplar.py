"""Run a deformation with `exemplar` guidance: fit the asset to what nouns stand for, or to meshes that were sent.

The source is read first, with what the request says of its noun, its front and its parts. Each prompt is fitted by
itself; with the displacements d_i(v) of the fits and the shares s_i(v) of the prompts at each vertex (`prompts`), the
asset moves by::

    d(v) = sum_i s_i(v) d_i(v)

Pictures beside the prompts pull at the outlines of that. Then what is kept, held and rigid is laid over it, and what
broke is mended.

The run is shorter than the interval of checkpoints, and its stages hold no state that is worth storing: a checkpoint
holds the shape, from which a branch starts, and a run that resumes starts again, to the same bytes.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.deformation.checkpoint import Checkpoint, dump_checkpoint, fingerprint, load_checkpoint, load_shape
from meshdeform.exemplar.engine import ExemplarFit
from meshdeform.exemplar.mending import Mended
from meshdeform.exemplar.outlines import outlined, outlines_of
from meshdeform.exemplar.outlook import FitOutlook, outlook
from meshdeform.exemplar.shapes import FitFrame as ExemplarFrame
from meshdeform.exemplar.shapes import Shape, Wish, frame_of
from meshdeform.exemplar.symmetry import symmetry_axes
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.pictures import SilhouetteView
from meshdeform.plain.body import Body
from meshdeform.plain.read_parts import ReadParts
from meshdeform.reading import NO_PART, Reading
from meshdeform.rendering.cameras import CameraFrame
from meshdeform.requests.choices import Carrier
from meshdeform.requests.parameters import SILHOUETTE_FIELDS, TARGET_FIELDS, WORDS_FIELD
from meshdeform.runs.base import RunInput, RunLog
from meshdeform.runs.believed import believed_source
from meshdeform.runs.control import WeldedSurface, read_control
from meshdeform.runs.drafts import FitSurface, in_place_of
from meshdeform.runs.exemplar_control import FitControls
from meshdeform.runs.exemplar_kind import STEPS
from meshdeform.runs.exemplar_report import DIGITS, ExemplarFacts, Fit, exemplar_report
from meshdeform.runs.facts import AssetFacts, Outcome, Wanted
from meshdeform.runs.fits import TargetFit
from meshdeform.runs.shape_run import ShapeRun
from meshdeform.runs.starts import Start
from meshdeform.runs.surfaces import shape_id
from meshdeform.vocabulary.grammar import parse

__all__ = ["ExemplarRun", "start_exemplar"]

_Floats = NDArray[np.float64]

_VERTS = "verts"
"""The tensor of a checkpoint that is its shape, in the cameras' frame."""


def start_exemplar(facts: AssetFacts, job_input: RunInput, log: RunLog) -> ExemplarRun:
    """Read the asset and the controls of a request, and start its fits."""
    request, params, asset, welded = facts.request, facts.params, facts.asset, facts.welded
    frame = CameraFrame.around(welded.mesh.verts)
    mesh = RestMesh.of(frame.place(welded.mesh))
    shape = shape_id(facts.file.digest, asset, params, request.output)
    guidance = _identity(job_input)
    run = fingerprint(params=params.model_dump(mode="json"), prompt=request.prompt, asset=shape, guidance=guidance)
    if job_input.checkpoint is not None:
        load_checkpoint(job_input.checkpoint, run)  # refuses that of another run
    with log.phase("prepare"):
        wanted = Wanted.of(facts, frame, mesh, job_input.files)
        stored = None if job_input.initial is None else load_shape(job_input.initial, shape)
        verts = None if stored is None else _shape(stored, facts, frame)
        targets = _targets(facts, job_input, frame)
    with log.phase("parts"):
        body = believed_source(facts, job_input, verts)
    known = ExemplarFacts(
        **vars(facts),
        **vars(wanted),
        frame=frame,
        shape_id=shape,
        fingerprint=run,
        targets=targets,
        reading=body.reader.reading,
        guidance=guidance,
    )
    return ExemplarRun(known, body, job_input, log)


def _identity(job_input: RunInput) -> dict[str, str]:
    """Return the identity of what guides a run: with the SHA-256 of what was sent, if anything was."""
    sent = [
        job_input.files[name].digest
        for name in (*TARGET_FIELDS, *SILHOUETTE_FIELDS, WORDS_FIELD)
        if name in job_input.files
    ]
    sha256 = hashlib.sha256("".join(sent).encode()).hexdigest() if sent else ""
    return {"id": "exemplar", "revision": "", "sha256": sha256}


def _shape(state: Mapping[str, NDArray[Any]], facts: AssetFacts, frame: CameraFrame) -> _Floats:
    """Return the vertices (V, 3) of a checkpoint of this or of an optimised run, in world space.

    `frame`: that of the cameras around the asset.
    """
    if _VERTS in state:
        return frame.leave(state[_VERTS])
    from meshdeform.deformation.loop import stored_shape

    start, surface = Start.of_state(state, facts.welded), WeldedSurface(facts.asset, facts.welded)
    control = read_control(facts.params, surface, start.frame, RestMesh.of(start.frame.place(facts.welded.mesh)))
    shape = stored_shape(start.mesh, state, Carrier.AUTO, bodies=control.bodies, constraints=control.constraints)
    return start.frame.leave(shape)


def _targets(facts: AssetFacts, job_input: RunInput, frame: CameraFrame) -> dict[str, TargetFit]:
    """Return the targets of a job by their parts, placed on its asset."""
    sent = {name: job_input.files[name] for name in TARGET_FIELDS if name in job_input.files}
    return {
        name: TargetFit.of(
            facts.params, facts.asset, facts.welded.mesh, load_asset(file.data, file.filename, job_input.limits), frame
        )
        for name, file in sent.items()
    }


class ExemplarRun(ShapeRun):
    """Fits in progress, created by `start_exemplar`."""

    _facts: ExemplarFacts

    def __init__(self, facts: ExemplarFacts, body: Body, job_input: RunInput, log: RunLog) -> None:
        self._labels = ReadParts(body).labels
        whole = FitSurface(body.points, body.faces, self._labels)
        self._is_draft = job_input.draft
        self._fitted = in_place_of(whole) if self._is_draft else whole
        self._wishes = _wishes(facts, self._fitted)
        super().__init__(facts, STEPS * len(self._wishes), 0, log)
        self._body, self._cache = body, job_input.readings.samples
        self._controls = FitControls(facts.control, facts.frame, facts.welded.mesh)
        self._shares = [None] if facts.prompts is None else facts.prompts.of_vertices(facts.welded.mesh)
        self._moves = [np.zeros_like(body.points) for _ in self._wishes]
        self._fits: list[Fit] = []
        self._result: _Floats | None = None
        self._mended: Mended | None = None

    def _steps(self) -> Iterator[dict[str, float]]:
        for number, (prompt, wish) in enumerate(self._wishes):
            own, reading = self._fitted, self._facts.reading
            fit = ExemplarFit(
                own.points, own.faces, reading, wish, labels=own.labels, cache=self._cache, mends=not self.is_draft
            )
            seconds: dict[str, float] = {}
            began = time.perf_counter()
            for stage in fit:
                seconds[stage.name] = seconds.get(stage.name, 0.0) + time.perf_counter() - began
                if stage.verts is not None and (own.binding is None or stage.share == 1):
                    self._moves[number] = own.followed(stage.verts) - self._body.points
                yield from self._steps_until(int((number + stage.share) * STEPS))
                began = time.perf_counter()
            self._fits.append(Fit(prompt, fit.result, seconds))
        self._result = self._whole()
        while self.step < self.total_steps:
            yield {}

    def _steps_until(self, step: int) -> Iterator[dict[str, float]]:
        """Yield until so many steps are done, but for the last one, before which all is mended."""
        while self.step < min(step, self.total_steps - 1):
            yield {}

    def checkpoint(self) -> bytes:
        """Return the current shape: a run that resumes starts again."""
        verts = self._facts.frame.enter(self.verts())
        state = Checkpoint(self.step, {_VERTS: verts})
        return dump_checkpoint(state, self._facts.fingerprint, self._facts.shape_id)

    def _report(self, outcome: Outcome) -> bytes:
        return exemplar_report(self._facts, self._fits, self._mended, outcome, self.log, self._foreseen)

    @property
    def reading(self) -> Reading | None:
        """What the asset was read as."""
        return self._facts.reading

    @property
    def warnings(self) -> list[str]:
        """Sentences about words that were read otherwise, and about what did not follow the shape."""
        notes = [note for prompt, _ in self._wishes if prompt for note in parse(prompt).notes]
        return [*notes, *super().warnings]

    @property
    def is_draft(self) -> bool:
        """Whether it ends where the surface, or a simplified one in its place, would slide and be mended."""
        return self._is_draft

    @property
    def members(self) -> list[dict[str, Any]]:
        """What the asset was fitted to, by prompt, as far as that is done."""
        return [dict(fit.result.member) for fit in self._fits]

    def as_start(self) -> Start:
        """Return the result, once all steps are done, for an optimisation that starts from it."""
        kept = {} if self._mended is None else {"kept": round(self._mended.kept, DIGITS)}
        told = [{name: each for name, each in fit.to_dict().items() if name != "seconds"} | kept for fit in self._fits]
        turn_deg = float(str(self._fits[0].result.member.get("turn_deg", 0.0)))
        return Start(TriangleMesh(self.verts(), self._facts.welded.mesh.faces), told, turn_deg)

    def _foreseen(self) -> FitOutlook | None:
        """Return what there is to expect of a fit to the only prompt."""
        (_, wish), body = self._wishes[0], self._body
        if len(self._wishes) > 1 or wish.targets:
            return None
        reading = self._facts.reading
        frame = frame_of(body.points, body.faces, reading)
        source = Shape("" if reading is None else reading.noun, frame.enter(body.points), body.faces, self._labels)
        return outlook(source, wish, cache=self._cache)

    def verts(self) -> _Floats:
        """Return the current welded vertices (V, 3) float64, in world space."""
        return self._blended() if self._result is None else self._result

    @property
    def _starts_at_rest(self) -> bool:
        """Whether the fits start from the asset, and not from the shape of another job, which may be broken."""
        return np.array_equal(self._body.points, self._facts.welded.mesh.verts)

    def _outlined(self, views: Sequence[SilhouetteView], verts: _Floats) -> _Floats:
        """Return vertices (V, 3) pulled to the outlines of pictures by a smooth map."""
        body = self._body
        frame = frame_of(body.points, body.faces, self._facts.reading)
        now = frame.enter(verts)
        outlines = outlines_of(views, frame.enter(body.points), body.faces, frame.turn)
        planes = symmetry_axes((now, body.faces), (now, body.faces))
        return frame.leave(outlined(now, body.faces, outlines, planes=planes))

    def _blended(self) -> _Floats:
        """Return the vertices (V, 3) that the fits have moved so far, each prompt by its share, within the controls."""
        moved = self._body.points.copy()
        for move, share in zip(self._moves, self._shares, strict=True):
            moved += move if share is None else share[:, None] * move
        return self._controls.laid_over(moved)

    def _whole(self) -> _Floats:
        """Return the vertices (V, 3) of the result; what blending, pictures and controls broke is mended."""
        blended, pictures = self._blended(), self._facts.silhouettes
        if pictures is not None:
            blended = self._controls.laid_over(self._outlined(pictures.views, blended))
        if self.is_draft:
            return blended
        if pictures is None and self._starts_at_rest and np.array_equal(blended, self._body.points + self._moves[0]):
            return blended
        self._mended = self._controls.mended(blended)
        return self._mended.verts


def _wishes(facts: ExemplarFacts, own: FitSurface) -> list[tuple[str, Wish]]:
    """Return what each prompt wishes, with its text, or what the targets are."""
    wish = Wish(strength=facts.params.strength, seed=facts.params.seed)
    if facts.targets:
        return [("", _for_targets(wish, facts, frame_of(own.points, own.faces, facts.reading)))]
    texts = [facts.request.prompt] if facts.prompts is None else [each.prompt for each in facts.prompts.given]
    asked = [parse(text) for text in texts]
    return [
        (text, replace(wish, noun=each.noun, attributes=each.attributes, borrowed=each.borrowed))
        for text, each in zip(texts, asked, strict=True)
    ]


def _for_targets(wish: Wish, facts: ExemplarFacts, own: ExemplarFrame) -> Wish:
    """Return a wish for the nearest of the targets, with their landmarks, in the frame of the fit."""

    def entered(points: _Floats) -> _Floats:
        return own.enter(facts.frame.leave(points))

    shapes, pairs = [], []
    for each in facts.targets.values():
        faces = each.target.faces
        shapes.append(Shape("", entered(each.target.verts), faces, np.full(len(faces), NO_PART)))
        pairs += [np.stack([mark.source, mark.target]) for mark in each.landmarks]
    ends = entered(np.array(pairs).reshape(-1, 3)).reshape(-1, 2, 3)
    landmarks = (ends[:, 0], ends[:, 1]) if pairs else None
    return replace(wish, targets=tuple(shapes), landmarks=landmarks)
