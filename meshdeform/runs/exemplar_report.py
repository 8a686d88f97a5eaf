"""Measure the result of a fit to exemplars on its file, read back, and build its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from meshdeform.exemplar.mending import Mended
from meshdeform.exemplar.outlook import FitOutlook
from meshdeform.exemplar.shapes import ExemplarResult
from meshdeform.geometry.mesh import RestMesh
from meshdeform.runs.base import RunLog
from meshdeform.runs.facts import GuidedFacts, Held, Outcome
from meshdeform.runs.fits import TargetFit
from meshdeform.runs.kept_structure import kept_structure
from meshdeform.runs.likeness import likeness, likeness_and_before, prompt_reports
from meshdeform.runs.reading import reading_report
from meshdeform.runs.recognition import Recognition
from meshdeform.runs.text_report import (
    common_members,
    guided_report,
    measure_movement,
    measured_result,
    rig_warnings,
    source_of,
)
from meshdeform.runs.worth import (
    UNMOVED,
    ShapeFigures,
    as_foreseen,
    of_exemplars,
    of_noun,
    of_pictures,
    of_prompts,
    of_shape_alone,
    of_target,
    worst,
)
from meshdeform.verdicts import Verdict
from meshdeform.vocabulary.grammar import parse

__all__ = ["DIGITS", "ExemplarFacts", "Fit", "exemplar_report"]

DIGITS = 6
_HARDLY = "The mesh hardly moved ({:.1%} of its size): the exemplar is much like it already."


@dataclass(frozen=True)
class ExemplarFacts(GuidedFacts):
    """Facts about a run before its fits."""

    targets: Mapping[str, TargetFit]  # by their parts, placed on the asset
    guidance: Mapping[str, str]  # the identity of what guides the run


@dataclass(frozen=True)
class Fit:
    """A fit that is done: of which prompt, empty for targets, its result, and the seconds of each of its stages."""

    prompt: str
    result: ExemplarResult
    seconds: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return its entry in `exemplars` of the report."""
        result = self.result
        return {
            "prompt": self.prompt,
            "member": dict(result.member),
            "distance_before": round(result.distance_before, DIGITS),
            "distance": round(result.distance, DIGITS),
            "pairs": [{"asset": own, "exemplar": other} for own, other in result.pairs],
            "left_over": list(result.left_over),
            "missing": list(result.missing),
            "kept": round(result.kept, DIGITS),
            "flipped_faces": result.flipped,
            "cut_faces": result.cut,
            "stretch": round(result.stretch, DIGITS),
            "seconds": {name: round(seconds, 4) for name, seconds in self.seconds.items()},
        }


def exemplar_report(
    facts: ExemplarFacts,
    fits: Sequence[Fit],
    mended: Mended | None,
    outcome: Outcome,
    log: RunLog,
    foresee: Callable[[], FitOutlook | None],
) -> bytes:
    """Return `report.json`.

    `mended`: what mending left of the blended fits within the controls; None of a fit that is mended itself. `foresee`:
    returns what there was to expect, of which a result that is not good tells.
    """
    params, asset, shown = facts.params, facts.asset, outcome.shown
    with log.phase("measure"):
        measured = measured_result(facts, outcome)
        quality = measured.quality.to_dict()
        movement = measure_movement(RestMesh.of(facts.welded.mesh), outcome.verts, Held())
        kept = [fit.result.kept for fit in fits] if mended is None else [mended.kept]
        # Parts take the proportions of those of the exemplar: that they swell says nothing.
        shape = ShapeFigures(
            kept_structure(shown.source, shown.result, quality),
            swollen=False,
            held=0.0,
            moved=movement.rms,
            distortion=quality["symmetric_dirichlet_mean"] or 1.0,
        )
        taken = _target_part(facts, fits)
        compared = _comparisons(facts, fits, outcome, shape, min(kept), taken)
        if compared["verdict"]["value"] != Verdict.GOOD:
            compared["verdict"] = as_foreseen(compared["verdict"], foresee())
    hardly = [_HARDLY.format(movement.rms)] if movement.rms < UNMOVED else []
    report = {
        **common_members(facts, outcome, measured),
        **dict.fromkeys(("carrier", "orientation", "appearance", "precision")),
        "way": "exemplar",
        "guidance": dict(facts.guidance),
        "fingerprint": facts.fingerprint,
        "exemplars": [fit.to_dict() | {"target": taken} for fit in fits],
        "source_noun": Recognition.of(params, facts.reading).to_dict(),
        "reading": reading_report(facts.reading, params),
        "movement": movement.to_dict(),
        "warnings": [
            *(note for fit in fits if fit.prompt for note in parse(fit.prompt).notes),
            *hardly,
            *measured.warnings(facts),
            *rig_warnings(asset, facts.request.output.rig),
        ],
        "losses": [],
        "resumed_from_step": 0,
        "seconds": {name: round(seconds, 4) for name, seconds in log.seconds.items()},
    }
    return guided_report(report, facts, outcome.written, compared)


def _target_part(facts: ExemplarFacts, fits: Sequence[Fit]) -> str | None:
    """Return the part of the target to which the asset was fitted; None if there was none."""
    return list(facts.targets)[int(str(fits[0].result.member["target"]))] if facts.targets else None


def _comparisons(
    facts: ExemplarFacts, fits: Sequence[Fit], outcome: Outcome, shape: ShapeFigures, kept: float, taken: str | None
) -> dict[str, Any]:
    """Return the members of the report that compare the result with what was asked for, and say what it is worth."""
    shown, known = outcome.shown, Recognition.of(facts.params, facts.reading)
    compared: dict[str, Any] = {}
    verdicts = []
    if facts.targets or facts.silhouettes is not None:
        in_frame = facts.frame.place(facts.welded.mesh), facts.frame.enter(outcome.verts)
        if taken is not None:
            compared["fit"] = facts.targets[taken].measure(*in_frame)
            verdicts.append(of_target(compared["fit"], shape))
        if facts.silhouettes is not None:
            compared["silhouettes"] = facts.silhouettes.measure(*in_frame)
            verdicts.append(of_pictures(compared["silhouettes"], shape))
    if facts.prompts is not None:
        compared["prompts"] = prompt_reports(facts.prompts, shown.source, shown.result, likeness)
        verdicts.append(of_prompts(compared["prompts"], shape))
    elif not facts.targets:
        prompt = facts.request.prompt
        compared["likeness"] = likeness_and_before(shown.source, shown.result, prompt)
        if compared["likeness"] is not None:
            source = source_of(shown, noun=known.noun, sure=known.sure)
            verdicts.append(of_noun(prompt, compared["likeness"], shape, source, fitted=True))
        else:
            result = fits[0].result
            verdicts.append(of_shape_alone(result.distance / max(result.distance_before, 1e-9), shape))
    verdicts.append(of_exemplars(kept, shape, _distance_left(fits)))
    return {**compared, "verdict": worst(verdicts)}


def _distance_left(fits: Sequence[Fit]) -> float | None:
    """Return the share of the distance that is left of a single fit of parts; None of others."""
    result = fits[0].result
    if len(fits) > 1 or result.member.get("way") in ("mould", "target") or not result.distance_before:
        return None
    return result.distance / result.distance_before
