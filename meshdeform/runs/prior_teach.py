"""Run jobs of kind `prior_teach`: teach the builtin prior nouns, measure what was learned, and write the weights."""

from __future__ import annotations

import datetime
import io
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
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
from meshdeform.priors.builtin.network import WEIGHTS, file_sha256, pack_weights, read_network
from meshdeform.priors.builtin.taught import Lesson, check, lessons_of, metadata_of, words_of
from meshdeform.priors.builtin.teaching.lesson import NewNoun, new_nouns
from meshdeform.priors.builtin.teaching.pictures import (
    LessonPictures,
    LessonSize,
    Shape,
    draw_lesson,
    read_replay,
    replay_of,
    replay_tensors,
    seen_turned,
    shape_of,
)
from meshdeform.priors.builtin.teaching.sheet import learned_sheet
from meshdeform.priors.builtin.teaching.teacher import (
    TeachConfig,
    Teacher,
    extended,
    fastest_precision,
    interval,
    read_state,
    retrieved,
)
from meshdeform.requests.choices import WEIGHTS_PART, is_sent, is_taught
from meshdeform.requests.document import read_unbounded
from meshdeform.requests.teaching import TeachParams
from meshdeform.runs.base import (
    TAUGHT_WEIGHTS,
    WEIGHTS_ARTIFACT,
    ArtifactData,
    JobRun,
    RunInput,
    params_of,
    sha256_hex,
    versions,
    weights_on_disk,
)
from meshdeform.runs.prior_teach_kind import (
    MESHES_PART,
    MeshFile,
    check_count,
    packed_meshes,
)

_LEARNED = 0.75
"""Least share of held-out pictures of the new noun that are taken for it."""
_FORGOTTEN = 2
"""Pictures of old nouns that may be lost without a warning."""


@dataclass(frozen=True)
class TeachRequest:
    """Order of a lesson."""

    synonyms: tuple[str, ...] = ()  # of the only noun
    replace: bool = False  # whether nouns that the weights know may get a new meaning
    licence: str = ""  # one line about the meshes' licence, for the file
    front_deg: float = 0.0  # azimuth of the front of the meshes, as in `params.guidance.orientation`
    base: Path = WEIGHTS  # weights to start from
    config: TeachConfig = field(default_factory=TeachConfig)
    size: LessonSize = field(default_factory=LessonSize)


def start(job_input: RunInput) -> LessonRun:
    """Unpack the meshes, read the weights to start from, and draw the pictures."""
    params = _params(job_input)
    limits = job_input.limits or Limits()
    with ExitStack() as stack:
        base = WEIGHTS
        if is_sent(params.model):
            base = stack.enter_context(weights_on_disk(job_input.files[WEIGHTS_PART]))
        elif is_taught(params.model):
            base = Path(params.model).expanduser()
        file = job_input.files[MESHES_PART]
        with hidden_folders([str(base)]):
            request = TeachRequest(
                synonyms=tuple(params.synonyms),
                replace=params.replace,
                licence=params.licence,
                front_deg=params.front_deg,
                base=base,
                config=TeachConfig(steps=params.steps, seed=params.seed),
            )
            meshes = packed_meshes(file.data, file.filename, params, check(base), limits)
            run = start_lesson(request, meshes, state=job_input.checkpoint, device=job_input.device, limits=limits)
        run.files = stack.pop_all()
        return run


def _params(job_input: RunInput) -> TeachParams:
    """Return the parameters stored when the request was accepted, as far as this version can read them."""
    params = params_of(job_input.request, TeachParams)
    if job_input.resolved is None:
        return params
    try:
        return read_unbounded(TeachParams, job_input.resolved)
    except ValidationError:
        # It has the path of a model that the request names by its id.
        return params.model_copy(update={"model": job_input.resolved["model"]})


def start_lesson(
    request: TeachRequest,
    files: Sequence[MeshFile],
    *,
    state: bytes | None = None,
    device: str = "cpu",
    limits: Limits | None = None,
) -> LessonRun:
    """Read the meshes and draw the pictures; go on from a saved state of the same lesson."""
    check_count(len(files))
    identity = _identity(request, files)
    saved = read_state(state, identity, device) if state is not None else None
    network, metadata = read_network(request.base)
    known = words_of(metadata, request.base)
    labels = {
        noun: [attribute for file in files if file.label.noun == noun for attribute in file.label.attributes]
        for noun in dict.fromkeys(file.label.noun for file in files)
    }
    new = new_nouns(labels, known, synonyms=request.synonyms, replace_known=request.replace)
    warnings: list[str] = []
    shapes = {
        noun.noun: [_shape(file, request, limits, warnings) for file in files if file.label.noun == name]
        for name, noun in zip(labels, new, strict=True)
    }
    for name, front in (turned for own in shapes.values() for turned in seen_turned(own).items()):
        warnings.append(
            f"{name} seems to face another way than the other meshes: its front seems to be at azimuth {front}. "
            "Turn it, or the model learns both."
        )
    seed = request.config.seed
    words = new[-1].words
    kept = replay_of(read_replay(request.base), words, shapes)
    pictures = draw_lesson(words, shapes, kept, request.size, seed)
    # The last lesson about a noun counts.
    lessons = [lesson for lesson in lessons_of(metadata, request.base) if lesson.noun not in shapes]
    for number, noun in enumerate(new):
        network, known = extended(network, known, noun, seed + number), noun.words
    teacher = Teacher(
        network,
        pictures,
        request.config,
        device=device,
        precision=fastest_precision(device),
        identity=identity,
    )
    if saved is not None:
        teacher.restore(saved)
    return LessonRun(request, new, shapes, files, pictures, teacher, lessons, warnings, device)


def _identity(request: TeachRequest, files: Sequence[MeshFile]) -> str:
    """Return a hash of all that decides the result, for saved states."""
    document = {
        **asdict(request),
        "base": file_sha256(request.base),
        "files": [
            (file.name, sha256_hex(file.data), file.label.noun, *map(str, file.label.attributes)) for file in files
        ],
        "torch": torch.__version__,
    }
    return sha256_hex(json.dumps(document, sort_keys=True, default=str).encode())


def _shape(file: MeshFile, request: TeachRequest, limits: Limits | None, warnings: list[str]) -> Shape:
    try:
        surface = load_asset(file.data, file.name, limits).surface
        mesh = weld(surface.positions, surface.triangles).mesh
        if looks_z_up(surface.positions, surface.triangles):
            warnings.append(f"{file.name} seems to have Z up, so the model learns it lying on its side.")
        return shape_of(mesh, file.name, front_deg=request.front_deg, attributes=file.label.attributes)
    except MeshdeformError as error:
        if file.name in error.detail:
            raise
        raise type(error)(f"{file.name}: {error.detail}", advice=error.advice_text, **error.extra) from error


class LessonRun(JobRun):
    """A lesson in progress, created by `start` or `start_lesson`.

    `files`: closed when the lesson is finished: the weights to start from may be a temporary file.
    """

    def __init__(
        self,
        request: TeachRequest,
        new: Sequence[NewNoun],
        shapes: Mapping[str, Sequence[Shape]],
        meshes: Sequence[MeshFile],
        pictures: LessonPictures,
        teacher: Teacher,
        lessons: Sequence[Lesson],
        warnings: list[str],
        device: str,
    ) -> None:
        super().__init__(request.config.steps, teacher.step)
        self.warnings, self.files = warnings, ExitStack()
        self._request, self._new, self._shapes, self._meshes = request, new, shapes, meshes
        self._pictures, self._teacher, self._lessons = pictures, teacher, lessons
        self._words = new[-1].words
        self.nouns = [each.noun for each in new]
        self._device = device

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
        mesh = next(iter(self._shapes.values()))[0].part
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
        request, words = self._request, self._words
        network = self._teacher.network()
        lessons = [
            Lesson(
                noun=new.noun,
                synonyms=new.synonyms,
                attributes=tuple(sorted({str(each) for shape in self._shapes[new.noun] for each in shape.attributes})),
                meshes=tuple(shape.name for shape in self._shapes[new.noun]),
                licence=" ".join(request.licence.split())[:500],
                date=datetime.datetime.now(datetime.UTC).date().isoformat(),
                steps=self._teacher.best_step,
                seed=request.config.seed,
            )
            for new in self._new
        ]
        state = {name: tensor.cpu() for name, tensor in network.state_dict().items()}
        kept = {**replay_of(read_replay(request.base), words, self._shapes), **self._pictures.kept}
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
        return pack_weights(state, network.config, provenance, metadata_of(words, [*self._lessons, *lessons]))

    def sheet(self) -> Any:
        """Draw the contact sheet (a PIL image) of what was learned."""
        network = self._teacher.network().cpu()
        return learned_sheet(network, self._words, self._pictures.kept, seed=self._request.config.seed)

    def report(self) -> dict[str, Any]:
        """Measure learning and forgetting, and describe the lesson.

        Retrieval asks the network itself: which noun explains a held-out picture best? Up to 30 old nouns have
        one grid of a member that the lesson did not show.
        """
        teacher, words = self._teacher, self._words
        before, metadata = read_network(self._request.base)
        base_words = words_of(metadata, self._request.base)
        after = teacher.network()
        held = self._pictures.held_old
        old_pictures = held.rows((~held.single).nonzero()[:, 0])  # one grid each: a noun takes a pass of the network
        names = [words.tokens[int(row[0])] for row in old_pictures.tokens]
        was = retrieved(before.to(after.place.device), base_words, old_pictures, list(base_words.nouns))
        now = retrieved(after, words, old_pictures, list(words.nouns))
        mine = self._pictures.held_new
        shown = [words.tokens[int(row[0])] for row in mine.tokens]
        seen_as = retrieved(after, words, mine, list(words.nouns))
        taken_for = {
            new.noun: Counter(seen for seen, noun in zip(seen_as, shown, strict=True) if noun == new.noun)
            for new in self._new
        }
        hits_before, hits_after = (sum(a == n for a, n in zip(some, names, strict=True)) for some in (was, now))
        return {
            "nouns": [
                {
                    "noun": new.noun,
                    "synonyms": list(new.synonyms),
                    "replaced": new.replaces,
                    "meshes": [self._described(shape) for shape in self._shapes[new.noun]],
                    "retrieval": _share(taken_for[new.noun][new.noun], taken_for[new.noun].total()),
                    "taken_for": dict(taken_for[new.noun].most_common()),
                }
                for new in self._new
            ],
            "pictures": len(self._pictures.training),
            "steps": {"done": teacher.step, "best": teacher.best_step, "most": self.total_steps},
            "stopped_early": teacher.stopped_early,
            "held_out_loss": [
                {"step": step, "new": round(a, 5), "old": round(b, 5)} for step, a, b in teacher.measured
            ],
            "retrieval": {
                "new": _share(sum(counts[noun] for noun, counts in taken_for.items()), len(shown)),
                "old_before": _share(hits_before, len(names)),
                "old_after": _share(hits_after, len(names)),
            },
            "old_nouns": {
                noun: {"before": int(a == noun), "after": int(b == noun)}
                for noun, a, b in zip(names, was, now, strict=True)
            },
            "warnings": [*self.warnings, *_doubts(taken_for, hits_before, hits_after)],
            "seed": self._request.config.seed,
            "device": self._device,
            "base_sha256": file_sha256(self._request.base),
        }

    def _described(self, shape: Shape) -> dict[str, Any]:
        data = next(file.data for file in self._meshes if file.name == shape.name)
        return {
            "name": shape.name,
            "sha256": sha256_hex(data),
            "faces": len(shape.part.faces),
            "attributes": [str(attribute) for attribute in shape.attributes],
            "held_out": shape.name in self._pictures.held_meshes,
        }


def _share(hits: int, count: int) -> dict[str, Any]:
    low, high = interval(hits, count)
    return {
        "hits": hits,
        "pictures": count,
        "share": round(hits / count, 4) if count else 0.0,
        "interval_95": [round(low, 4), round(high, 4)],
    }


def _doubts(taken_for: Mapping[str, Counter[str]], before: int, after: int) -> list[str]:
    """Return the warnings that follow from the measures."""
    warnings = [
        f"Only {counts[noun]} of {counts.total()} held-out pictures are taken for a {noun}: take more steps or meshes, "
        "or meshes that differ more from what the model knows."
        for noun, counts in taken_for.items()
        if counts[noun] < _LEARNED * counts.total()
    ]
    if after < before - _FORGOTTEN:
        warnings.append(f"The model takes {after} pictures of old nouns for what they show; before, {before}.")
    return warnings
