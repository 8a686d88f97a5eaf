"""Run jobs of kind `prior_teach`: teach the builtin prior a noun, measure what was learned, and write the weights."""

from __future__ import annotations

import datetime
import io
import json
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from pydantic import ValidationError

from meshdeform.assets import Limits, build_glb, load_asset
from meshdeform.assets.notices import looks_z_up
from meshdeform.errors import MeshdeformError
from meshdeform.geometry.weld import weld
from meshdeform.priors import hidden_folders
from meshdeform.priors.builtin.network import WEIGHTS, PriorNetwork, file_sha256, pack_weights, read_network
from meshdeform.priors.builtin.taught import Lesson, check, lessons_of, metadata_of, words_of
from meshdeform.priors.builtin.teaching.lesson import NewNoun, new_noun
from meshdeform.priors.builtin.teaching.measure import interval, retrieved
from meshdeform.priors.builtin.teaching.picture_set import taken
from meshdeform.priors.builtin.teaching.pictures import LessonPictures, LessonSize, draw_lesson, replay_of
from meshdeform.priors.builtin.teaching.replay import read_replay, replay_tensors
from meshdeform.priors.builtin.teaching.shapes import Shape, seen_turned, shape_of
from meshdeform.priors.builtin.teaching.sheet import learned_sheet
from meshdeform.priors.builtin.teaching.teacher import (
    TeachConfig,
    Teacher,
    extended,
    fastest_precision,
    read_state,
)
from meshdeform.requests.choices import WEIGHTS_PART, is_sent, is_taught
from meshdeform.requests.document import JobRequest, read_unbounded
from meshdeform.requests.teaching import TeachParams
from meshdeform.runs import family_synthesize
from meshdeform.runs.base import (
    TAUGHT_WEIGHTS,
    WEIGHTS_ARTIFACT,
    ArtifactData,
    InputFile,
    JobRun,
    RunInput,
    sha256_hex,
    versions,
    weights_on_disk,
)
from meshdeform.runs.prior_teach_kind import (
    FAMILY_PART,
    MESHES_PART,
    MeshFile,
    check_count,
    noun_of_request,
    packed_meshes,
    params_of,
)

_LEARNED = 0.75
"""Least share of held-out pictures of the new noun that are taken for it."""
_FORGOTTEN = 2
"""Pictures of old nouns that may be lost without a warning."""

MADE = 60
"""Members that a lesson makes of a family: as many as it draws of a mesh."""


@dataclass(frozen=True)
class TeachRequest:
    """What to teach, and how."""

    noun: str  # as the user wrote it: "a gnome"
    synonyms: tuple[str, ...] = ()
    replace: bool = False  # whether a noun that the weights know may get a new meaning
    licence: str = ""  # one line about the meshes' licence, for the file
    front_deg: float = 0.0  # azimuth of the front of the meshes, as in `params.guidance.orientation`
    base: Path = WEIGHTS  # weights to start from
    config: TeachConfig = field(default_factory=TeachConfig)
    size: LessonSize = field(default_factory=LessonSize)


def start(given: RunInput) -> LessonRun:
    """Unpack the meshes, read the weights to start from, and draw the pictures.

    Raises
    ------
    AssetError, RequestError, ModelError, CheckpointError
        The input cannot be run; the error says what to do.
    """
    params = _params(given)
    limits = given.limits or Limits()
    with ExitStack() as stack:
        base = WEIGHTS
        if is_sent(params.model):
            base = stack.enter_context(weights_on_disk(given.files[WEIGHTS_PART]))
        elif is_taught(params.model):
            base = Path(params.model).expanduser()
        file = given.files[MESHES_PART]
        with hidden_folders([str(base)]):
            new = noun_of_request(params, check(base))
            request = TeachRequest(
                noun=params.noun,
                synonyms=tuple(params.synonyms),
                replace=params.replace,
                licence=params.licence,
                front_deg=params.front_deg,
                base=base,
                config=TeachConfig(steps=params.steps, seed=params.seed),
            )
            meshes = packed_meshes(file.data, file.filename, new, limits)
            family = given.files[FAMILY_PART].data if FAMILY_PART in given.files else None
            run = start_lesson(
                request, meshes, family=family, state=given.checkpoint, device=given.device, limits=limits
            )
        run.files = stack.pop_all()
        return run


def _params(given: RunInput) -> TeachParams:
    """Return the parameters stored when the request was accepted, as far as this version can read them."""
    params = params_of(given.request)
    if given.resolved is None:
        return params
    try:
        return read_unbounded(TeachParams, given.resolved)
    except ValidationError:
        # It has the path of a model that the request names by its id.
        return params.model_copy(update={"model": given.resolved["model"]})


def start_lesson(
    request: TeachRequest,
    files: Sequence[MeshFile],
    *,
    family: bytes | None = None,
    state: bytes | None = None,
    device: str = "cpu",
    limits: Limits | None = None,
) -> LessonRun:
    """Read the meshes and draw the pictures; go on from a saved state of the same lesson.

    With a `family` that was fitted to the meshes, its `family.safetensors`, members are new shapes of it instead of
    jittered meshes.

    Raises
    ------
    ParameterError
        There is no file, there are too many, or the noun cannot be taught.
    ModelError
        The weights to start from cannot be read.
    CheckpointError
        The state is of another lesson, or unreadable.
    AssetError
        A file cannot be read, or too little of its mesh can be seen; the message names the file.
    """
    check_count(len(files))
    identity = _identity(request, files, family)
    saved = read_state(state, identity, device) if state is not None else None
    network, metadata = read_network(request.base)
    known = words_of(metadata, request.base)
    new = new_noun(request.noun, known, synonyms=request.synonyms, replace_known=request.replace)
    new = new.with_parts([attribute.part for file in files for attribute in file.attributes])
    warnings: list[str] = []
    shapes = [_shape(file, request, limits, warnings) for file in files]
    for name, front in seen_turned(shapes).items():
        warnings.append(
            f"{name} seems to face another way than the other meshes: its front seems to be at azimuth {front}. "
            "Turn it, or the model learns both."
        )
    seed = request.config.seed
    made = made_members(family, files, seed, limits) if family is not None else []
    more = [_shape(file, request, limits, []) for file in made]
    kept = replay_of(read_replay(request.base), new)
    pictures = draw_lesson(new, shapes, kept, request.size, seed, made=more)
    # The last lesson about a noun counts.
    lessons = [lesson for lesson in lessons_of(metadata, request.base) if lesson.noun != new.noun]
    teacher = Teacher(
        extended(network, known, new, seed),
        pictures,
        request.config,
        device=device,
        precision=fastest_precision(device),
        identity=identity,
    )
    if saved is not None:
        teacher.restore(saved)
    return LessonRun(request, new, shapes, files, pictures, teacher, network, lessons, warnings, device, len(made))


def _identity(request: TeachRequest, files: Sequence[MeshFile], family: bytes | None) -> str:
    """Return a hash of all that decides the result, for saved states."""
    document = {
        **asdict(request),
        "base": file_sha256(request.base),
        "files": [(file.name, sha256_hex(file.data), list(map(str, file.attributes))) for file in files],
        "torch": torch.__version__,
        **({"family": sha256_hex(family)} if family is not None else {}),
    }
    return sha256_hex(json.dumps(document, sort_keys=True, default=str).encode())


def _shape(file: MeshFile, request: TeachRequest, limits: Limits | None, warnings: list[str]) -> Shape:
    try:
        surface = load_asset(file.data, file.name, limits).surface
        mesh = weld(surface.positions, surface.triangles).mesh
        if looks_z_up(surface.positions, surface.triangles):
            warnings.append(f"{file.name} seems to have Z up, so the model learns it lying on its side.")
        return shape_of(mesh, file.name, front_deg=request.front_deg, attributes=file.attributes)
    except MeshdeformError as error:
        if file.name in error.detail:
            raise
        raise type(error)(f"{file.name}: {error.detail}", advice=error.advice_text, **error.extra) from error


class LessonRun(JobRun):
    """A lesson in progress, created by `start` or `start_lesson`.

    Attributes
    ----------
    files : ExitStack
        Closed when the lesson is finished: the weights to start from may be a temporary file.
    """

    def __init__(
        self,
        request: TeachRequest,
        new: NewNoun,
        shapes: Sequence[Shape],
        meshes: Sequence[MeshFile],
        pictures: LessonPictures,
        teacher: Teacher,
        before: PriorNetwork,
        lessons: Sequence[Lesson],
        warnings: list[str],
        device: str,
        made: int = 0,
    ) -> None:
        super().__init__(request.config.steps, teacher.step)
        self.noun, self.warnings, self.files = new.noun, warnings, ExitStack()
        self._request, self._new, self._shapes, self._meshes = request, new, shapes, meshes
        self._pictures, self._teacher, self._before, self._lessons = pictures, teacher, before, lessons
        self._device, self._made = device, made

    def _steps(self) -> Iterator[dict[str, float]]:
        """Run the remaining steps; fewer if the held-out loss has stopped to fall."""
        for done in self._teacher:
            losses = {"total": done.loss}
            if done.held_new is not None and done.held_old is not None:
                losses |= {"held_out_new": done.held_new, "held_out_old": done.held_old}
            yield losses

    def checkpoint(self) -> bytes:
        """Return the complete state; call only between two steps."""
        return self._teacher.state()

    def snapshot(self) -> ArtifactData:
        """Return the first mesh as the training sees it: +Y up, facing +Z, centred."""
        mesh = self._shapes[0].part
        return ArtifactData(build_glb(mesh.verts, mesh.faces), "model/gltf-binary")

    def finish(self) -> dict[str, ArtifactData]:
        """Return the weights, the report and the contact sheet."""
        with self.files:
            weights, sheet = self.weights(), io.BytesIO()
            self.sheet().save(sheet, "PNG", optimize=True)
            report = {
                **self.report(),
                "result": {"sha256": sha256_hex(weights), "bytes": len(weights)},
                "fingerprint": self._teacher.identity,
                "versions": versions(),
            }
        text = json.dumps(report, indent=2, ensure_ascii=False) + "\n"
        return {
            WEIGHTS_ARTIFACT: ArtifactData(weights, TAUGHT_WEIGHTS),
            "report.json": ArtifactData(text.encode(), "application/json"),
            "preview.png": ArtifactData(sheet.getvalue(), "image/png"),
        }

    def weights(self) -> bytes:
        """Return the file of the weights that were best so far."""
        request, new = self._request, self._new
        words = new.words
        attributes = sorted({str(attribute) for file in self._meshes for attribute in file.attributes})
        lesson = Lesson(
            noun=new.noun,
            synonyms=new.synonyms,
            attributes=tuple(attributes),
            meshes=tuple(file.name for file in self._meshes),
            licence=" ".join(request.licence.split())[:500],
            date=datetime.datetime.now(datetime.UTC).date().isoformat(),
            steps=self._teacher.best_step,
            seed=request.config.seed,
        )
        state = {name: tensor.cpu() for name, tensor in self._teacher.network().state_dict().items()}
        kept = {**replay_of(read_replay(request.base), new), new.noun: self._pictures.kept}
        for noun, pictures in kept.items():
            state |= replay_tensors(noun, pictures)
        provenance = {
            "steps": str(self._teacher.best_step),
            "total_steps": str(request.config.steps),
            "seed": str(request.config.seed),
            "batch": str(request.config.batch),
            "pictures": str(len(self._pictures.training)),
            "initial": file_sha256(request.base),
        }
        config = self._before.config
        return pack_weights(state, config, provenance, metadata_of(words, [*self._lessons, lesson]))

    def sheet(self) -> Any:
        """Draw the contact sheet (a PIL image) of what was learned."""
        network = self._teacher.network().cpu()
        return learned_sheet(
            network, self._new.words, self._new.noun, self._pictures.kept, seed=self._request.config.seed
        )

    def report(self) -> dict[str, Any]:
        """Measure what was learned and forgotten, and describe the lesson.

        Retrieval asks the network itself: which noun explains a held-out picture best? Up to 30 old nouns have
        one grid of a member that the lesson did not show.
        """
        new, teacher = self._new, self._teacher
        after = teacher.network()
        before = self._before.to(after.place.device)
        base_words = words_of(read_network(self._request.base)[1], self._request.base)
        held = self._pictures.held_old
        old_pictures = taken(held, (~held.single).nonzero()[:, 0])  # one grid each: a noun takes a pass of the network
        names = [new.words.tokens[int(row[0])] for row in old_pictures.tokens]
        was = retrieved(before, base_words, old_pictures, list(base_words.nouns))
        now = retrieved(after, new.words, old_pictures, list(new.words.nouns))
        mine = retrieved(after, new.words, self._pictures.held_new, list(new.words.nouns))
        old = {
            noun: {
                "before": sum(a == noun for a, n in zip(was, names, strict=True) if n == noun),
                "after": sum(a == noun for a, n in zip(now, names, strict=True) if n == noun),
                "pictures": names.count(noun),
            }
            for noun in dict.fromkeys(names)
        }
        return {
            "noun": new.noun,
            "synonyms": list(new.synonyms),
            "replaced": new.replaces,
            "meshes": [
                {
                    "name": file.name,
                    "sha256": sha256_hex(file.data),
                    "faces": len(shape.part.faces),
                    "attributes": [str(attribute) for attribute in file.attributes],
                    "held_out": shape.name == self._pictures.held_mesh,
                }
                for file, shape in zip(self._meshes, self._shapes, strict=True)
            ],
            "made_members": self._made,
            "pictures": len(self._pictures.training),
            "steps": {"done": teacher.step, "best": teacher.best_step, "most": self.total_steps},
            "stopped_early": teacher.stopped_early,
            "held_out_loss": [
                {"step": step, "new": round(a, 5), "old": round(b, 5)} for step, a, b in teacher.measured
            ],
            "retrieval": {
                "new": _share(mine.count(new.noun), len(mine)),
                "old_before": _share(sum(a == n for a, n in zip(was, names, strict=True)), len(names)),
                "old_after": _share(sum(a == n for a, n in zip(now, names, strict=True)), len(names)),
                "taken_for": {noun: mine.count(noun) for noun in dict.fromkeys(mine)},
            },
            "old_nouns": old,
            "warnings": [
                *self.warnings,
                *_doubts(
                    new.noun,
                    mine,
                    sum(a == n for a, n in zip(was, names, strict=True)),
                    sum(a == n for a, n in zip(now, names, strict=True)),
                ),
            ],
            "seed": self._request.config.seed,
            "device": self._device,
            "base_sha256": file_sha256(self._request.base),
        }


def _share(hits: int, count: int) -> dict[str, Any]:
    low, high = interval(hits, count)
    return {
        "hits": hits,
        "pictures": count,
        "share": round(hits / count, 4) if count else 0.0,
        "interval_95": [round(low, 4), round(high, 4)],
    }


def _doubts(noun: str, found: Sequence[str], before: int, after: int) -> list[str]:
    """Return what the measures warn of."""
    warnings = []
    if found.count(noun) < _LEARNED * len(found):
        warnings.append(
            f"Only {found.count(noun)} of {len(found)} held-out pictures are taken for a {noun}: take more steps or "
            "meshes, or meshes that differ more from what the model knows."
        )
    if after < before - _FORGOTTEN:
        warnings.append(f"The model takes {after} pictures of old nouns for what they show; before, {before}.")
    return warnings


def made_members(family: bytes, files: Sequence[MeshFile], seed: int, limits: Limits | None = None) -> list[MeshFile]:
    """Return `MADE` new shapes of a family; the same seed gives the same shapes.

    Parameters
    ----------
    family : bytes
        The `family.safetensors` of a fit.
    files : sequence of MeshFile
        The collection that was fitted.

    Raises
    ------
    AssetError
        The family cannot be read, or the files are not those that it was fitted to.
    """
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.name), file.data)
    request = JobRequest.model_validate({"kind": "family_synthesize", "params": {"count": MADE, "seed": seed}})
    given = {
        "family": InputFile(family, "family.safetensors"),
        "collection": InputFile(packed.getvalue(), "collection.zip"),
    }
    run = family_synthesize.start(RunInput(request, given, limits=limits))
    for _ in run:
        pass
    return [MeshFile(f"shape_{number:02d}.glb", shape) for number, shape in enumerate(run.shapes)]
