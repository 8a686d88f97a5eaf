"""Print the results of each kind of job: a summary for `--json`, lines about its report for people."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from meshdeform.cli.output import emit
from meshdeform.requests.choices import JobKind
from meshdeform.requests.kind_folders import kind_table
from meshdeform.verdicts import Verdict, read_verdict

if TYPE_CHECKING:
    from meshdeform.cli.local import FinishedRun
    from meshdeform.cli.options import Printed

_DRAWN = "animation"
"""The name of what a command draws beside the artifacts of a run."""
_FILES = {
    "result": ("result.glb", "GLB"),
    "morph": ("morph.glb", "Morph GLB"),
    "report": ("report.json", "Report"),
    "preview": ("preview.png", "Picture"),
    "animation": (_DRAWN, "Animation"),
}
"""Members of a deformation's summary that are files: their artifacts and titles."""


def print_result(kind: str, run: FinishedRun, files: Mapping[str, Path], printed: Printed) -> None:
    """Print the result of a job of any kind, whose files are named by artifact, as JSON or in lines."""
    summarise, lines = {JobKind.TEXT_DEFORM: (_deformation, _deformation_lines), **kind_table("commands", "PRINTED")}[
        kind
    ]
    summary = summarise(run, {name: path for name, path in files.items() if name in run.artifacts or name == _DRAWN})
    if printed.as_json:
        emit(summary)
    elif not printed.quiet:
        for line in filter(None, lines(summary)):
            typer.echo(line)
        for warning in summary["warnings"]:
            typer.echo(warning, err=True)


def _deformation(run: FinishedRun, files: Mapping[str, Path]) -> dict[str, Any]:
    report = run.report
    names = (
        *("source_noun", "reading", "carrier", "orientation", "appearance", "likeness", "prompts"),
        *("texture_stretch", "quality", "posed_quality", "silhouettes", "way", "changes", "exemplars"),
    )
    return {
        "verdict": read_verdict(report),
        **{title: str(files[name]) if name in files else None for title, (name, _) in _FILES.items()},
        "steps": run.steps,
        "resumed_from": run.resumed_from,
        "losses": run.losses,
        **{name: report.get(name) for name in names},
        "faces": report["mesh"]["welded_faces"],
        "fit": report.get("fit") and report["fit"] | {"quality": report["quality"]},
        "warnings": [*report["input"]["warnings"], *report["warnings"]],
        "elapsed_s": run.elapsed_s,
    }


def _deformation_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    yield from (f"{title:<10} {summary[name]}" for name, (_, title) in _FILES.items() if summary[name] is not None)
    if summary["verdict"] is not None:
        yield verdict_line(summary["verdict"])
    yield source_line(summary)
    if summary["changes"] is not None:
        yield from change_lines(summary["changes"])
    elif summary["exemplars"] is not None:
        yield from exemplar_lines(summary["exemplars"])
    else:
        yield orientation_line(summary["orientation"])
        yield summary["appearance"]["notice"] or ""
    if summary["prompts"] is not None:
        yield from prompt_lines(summary["prompts"])
    elif summary["likeness"] is not None:
        yield likeness_line(summary["likeness"])
    if summary["verdict"] is None or summary["verdict"]["value"] == Verdict.GOOD:
        yield kept_line(summary["posed_quality"] or summary["quality"])
    more: dict[str, Callable[[Any], str]] = {
        "texture_stretch": stretch_line,
        "fit": fit_line,
        "silhouettes": silhouettes_line,
    }
    yield from (line(summary[name]) for name, line in more.items() if summary[name] is not None)


def folder_summary(run: FinishedRun, files: Mapping[str, Path]) -> dict[str, Any]:
    """Return the summary of a run all of whose artifacts are in a folder, with what its report has of these members."""
    printed = ("parts", "accuracy", "classes", "strangers", "shapes", "nearest_members", "warnings")
    return {
        "folder": str(next(iter(files.values())).parent),
        "files": list(run.artifacts),
        "steps": run.steps,
        "resumed": run.resumed_from is not None,
        **{name: run.report[name] for name in printed if name in run.report},
    }


def fit_line(fit: Mapping[str, Any]) -> str:
    """Return the line for `fit` of a run's summary."""
    quality = fit["quality"]
    return (
        f"Fit        {fit['within']:.0%} of the target within 1 %; mean distance {fit['to_target']:.2%} to it and "
        f"{fit['from_target']:.2%} from it; silhouettes {fit['silhouettes']:.0%}; distortion "
        f"{quality['symmetric_dirichlet_mean']:.2f}; {quality['flipped_faces']} flipped faces"
    )


def likeness_line(likeness: Mapping[str, Any]) -> str:
    """Return the line for the report's `likeness`."""
    noun, other = _named(likeness["noun"]), _named(likeness["next"]["noun"])
    share, others = percent(likeness["probability"]), percent(likeness["next"]["probability"])
    if likeness["matches"]:
        return f"Looks like: {noun} ({share} among the judge's {likeness['nouns']} nouns); next: {other} ({others})"
    rank = f"{noun} ({share}) is number {likeness['rank']} of {likeness['nouns']}"
    return f"Does not look like its prompt: it looks more like {other} ({others}); {rank}"


def kept_line(quality: Mapping[str, Any]) -> str:
    """Return the line for `kept_share` of the report's quality."""
    return f"Still your asset: {quality['kept_share']:.0%} of the surface kept its shape"


def verdict_line(verdict: Mapping[str, Any]) -> str:
    """Return the line for a report's verdict, as `read_verdict` returns it: its value, why, and what helps."""
    return f"{verdict['value']}: {' '.join([*verdict['reasons'], *verdict['advice']])}"


def _named(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def percent(share: float) -> str:
    """Return a probability of a noun as it is printed."""
    return "under 1%" if share < 0.005 else f"{share:.0%}"


def orientation_line(orientation: Mapping[str, Any]) -> str:
    """Return the line for the report's `orientation`; empty if the front was not to be chosen."""
    if orientation["source"] in ("found", "undecided"):
        unclear = "; no side is clearly better" if orientation["source"] == "undecided" else ""
        return f"Front: the side at {orientation['turn_deg']:g} degrees (0 is +Z, 90 is +X){unclear}"
    return f"Front: +Z. {orientation['notice']}" if orientation["notice"] else ""


def source_line(report: Mapping[str, Any]) -> str:
    """Return the line for the report's `reading`, or its `source_noun`, and `carrier`; empty if none says anything."""
    parts = []
    noun, carrier = report["source_noun"], report["carrier"]
    reading = report.get("reading")
    if reading is not None:
        parts += [line.rstrip(".") for line in reading_lines(reading)]
    elif noun is not None and noun["recognised"]:
        parts.append(f"Taken for: {noun['noun']} ({noun['probability']:.0%}; --set source_noun=NOUN corrects it)")
    carrier = carrier or {}
    kept = [f"mirror symmetry across {' and '.join(carrier['mirror'])}"] if carrier.get("mirror") else []
    kept += ["level and upright"] if carrier.get("level") else []
    if kept:
        parts.append(f"Kept: {', '.join(kept)}")
    return ". ".join(parts)


def reading_lines(reading: Mapping[str, Any] | None) -> list[str]:
    """Return a line about what an asset was read as; none if it could not be read."""
    if reading is None:
        return []
    noun, zero = reading["noun"], "+Z" if reading["up"] == "+Y" else "-Y"
    front = f"{reading['front_azimuth_deg']:g} degrees (0 is {zero}, 90 is +X)"
    if reading["noun_given"]:
        read = f"Given: {noun}"
    else:
        likely = [each for each in reading["nouns"] if each["noun"] != noun]  # more so, where a prompt was believed
        others = [f"{each['noun']} {percent(each['probability'])}" for each in likely[:2]]
        instead = "" if reading["sure"] or not others else f", or {', '.join(others)}"
        read = f"Read as: {noun} ({percent(reading['probability'])}{instead}; --source-noun NOUN corrects it)"
    given = ", as given" if reading["front_given"] else ""
    sure = given if given or reading["front_sure"] else ", which is not sure; its azimuth in degrees corrects it"
    lies = "" if reading["up"] == "+Y" else f" {reading['up']} counts as up (--up corrects it)."
    return [f"{read}; front at {front}{sure}.{lies}"]


def change_lines(changes: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Return a line for each of the report's `changes`."""
    for each in changes:
        part = "" if each["part"] == "whole" else f" {each['part']} (found by {each['found_by']})"
        yield f"Changed: {each['operation']}{part}, {each['asked']:.2f} asked, {each['got']:.2f} got"


def exemplar_lines(exemplars: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Return lines for each of the report's `exemplars`: what was taken, how near it is, and what has no partner."""
    for each in exemplars:
        member = each["member"]
        verb = "Moulded into" if member.get("way") == "mould" else "Fitted to"
        yield (
            f"{verb}: {each['target'] or _design(member)}; mean distance {each['distance']:.2%} of the diagonal, "
            f"{each['distance_before']:.2%} before; it went {each['kept']:.0%} of the way"
        )
        pairs = [
            pair["asset"] if pair["asset"] == pair["exemplar"] else f"{pair['asset']} as {pair['exemplar']}"
            for pair in each["pairs"]
        ]
        sides = {"paired": pairs, "only the asset has": each["left_over"], "only the exemplar has": each["missing"]}
        listed = "; ".join(f"{side}: {', '.join(dict.fromkeys(parts))}" for side, parts in sides.items() if parts)
        yield listed[:1].upper() + listed[1:]


def _design(member: Mapping[str, Any]) -> str:
    """Return what names a member of a noun: "a giraffe (member 37, standing)"."""
    told = [f"member {member['number']}"] if "number" in member else []
    told += [str(member[name]) for name in ("form", "pose") if member.get(name) not in (None, "", member["noun"])]
    return f"{_named(member['noun'])} ({', '.join(told)})" if told else _named(member["noun"])


def stretch_line(stretch: Mapping[str, float]) -> str:
    """Return the line for the report's `texture_stretch`."""
    line = f"Texture stretch: {stretch['p50']:.2f} at the median, {stretch['p95']:.2f} at the 95th percentile"
    return f"{line}; {stretch['above_2']:.0%} of the textured surface above 2"


def silhouettes_line(silhouettes: Sequence[Mapping[str, Any]]) -> str:
    """Return the line for `silhouettes` of a run's summary."""
    views = (f"{each['azimuth']:g} degrees {each['iou_before']:.1%} to {each['iou']:.1%}" for each in silhouettes)
    return f"Pictures   overlap of the silhouettes: {'; '.join(views)}"


def prompt_lines(prompts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line for each of the report's `prompts` that was compared with the result."""
    lines = []
    for each in prompts:
        if each.get("likeness") is not None:
            before = each["likeness"].get("before")
            earlier = f", {percent(before['probability'])} before" if before else ""
            where = f" (in its region{earlier})" if each["regions"] else ""
            lines.append(f"{each['prompt']}{where}: {likeness_line(each['likeness'])}")
    return lines
