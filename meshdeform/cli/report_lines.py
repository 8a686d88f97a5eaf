"""Say in lines what the report of a deformation says, and sum it up for `--json`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

__all__ = [
    "fit_line",
    "kept_line",
    "likeness_line",
    "orientation_line",
    "prompt_lines",
    "report_lines",
    "report_summary",
    "silhouettes_line",
    "source_line",
    "stretch_line",
    "verdict_line",
]


def report_summary(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parts of a report that the command line prints."""
    names = (
        *("source_noun", "carrier", "orientation", "appearance", "likeness", "verdict", "prompts"),
        *("texture_stretch", "quality", "posed_quality", "silhouettes"),
    )
    return {
        **{name: report.get(name) for name in names},
        "faces": report["mesh"]["welded_faces"],
        "fit": report.get("fit") and report["fit"] | {"quality": report["quality"]},
        "warnings": [*report["input"]["warnings"], *report["warnings"]],
    }


def report_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines about a result; `summary` is that of its report."""
    yield source_line(summary)
    yield orientation_line(summary["orientation"])
    yield summary["appearance"]["notice"] or ""
    if summary["prompts"] is not None:
        yield from prompt_lines(summary["prompts"])
    elif summary["likeness"] is not None:
        yield likeness_line(summary["likeness"])
    yield kept_line(summary["posed_quality"] or summary["quality"])
    more: dict[str, Callable[[Any], str]] = {
        "verdict": verdict_line,
        "texture_stretch": stretch_line,
        "fit": fit_line,
        "silhouettes": silhouettes_line,
    }
    yield from (line(summary[name]) for name, line in more.items() if summary[name] is not None)


def fit_line(fit: Mapping[str, Any]) -> str:
    """Return the line for `fit` of a run's summary."""
    quality = fit["quality"]
    return (
        f"Fit        {fit['within']:.0%} of the target within 1 %; mean distance {fit['to_target']:.2%} to it and "
        f"{fit['from_target']:.2%} from it; silhouettes {fit['silhouettes']:.0%}; distortion "
        f"{quality['symmetric_dirichlet_mean']:.2f}; {quality['flipped_faces']} flipped faces"
    )


def likeness_line(found: Mapping[str, Any]) -> str:
    """Return the line for the report's `likeness`."""
    noun, other = _named(found["noun"]), _named(found["next"]["noun"])
    share, others = percent(found["probability"]), percent(found["next"]["probability"])
    if found["matches"]:
        return f"Looks like: {noun} ({share} among the judge's {found['nouns']} nouns); next: {other} ({others})"
    place = f"{noun} ({share}) is number {found['rank']} of {found['nouns']}"
    return f"Does not look like its prompt: it looks more like {other} ({others}); {place}"


def kept_line(quality: Mapping[str, Any]) -> str:
    """Return the line for `kept_share` of the report's quality."""
    return f"Still your asset: {quality['kept_share']:.0%} of the surface kept its shape"


def verdict_line(verdict: Mapping[str, Any]) -> str:
    """Return the line for the report's `verdict`; empty if the result is not worse than its source."""
    reasons = " ".join(verdict["reasons"])
    return f"Verdict: keep your asset as it is ({verdict['value']}). {reasons}" if reasons else ""


def _named(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def percent(share: float) -> str:
    """Return a probability of a noun as it is printed."""
    return "under 1%" if share < 0.005 else f"{share:.0%}"


def orientation_line(found: Mapping[str, Any]) -> str:
    """Return the line for the report's `orientation`; empty if the front was not to be chosen."""
    if found["source"] == "found":
        return (
            f"Front: the side at {found['turn_deg']:g} degrees (0 is +Z, 90 is +X); "
            f"it fits what the asset is {found['margin']:.0%} better than the next one"
        )
    if found["source"] == "undecided":
        return f"Front: the side at {found['turn_deg']:g} degrees (0 is +Z, 90 is +X); no side is clearly better"
    return f"Front: +Z. {found['notice']}" if found["notice"] else ""


def source_line(report: Mapping[str, Any]) -> str:
    """Return the line for the report's `source_noun` and `carrier`; empty if neither says anything."""
    parts = []
    noun, carrier = report["source_noun"], report["carrier"]
    if noun is not None and noun["recognised"]:
        parts.append(f"Taken for: {noun['noun']} ({noun['probability']:.0%}; --set source_noun=NOUN corrects it)")
    kept = [f"mirror symmetry across {carrier['mirror']}"] if carrier.get("mirror") else []
    kept += ["level and upright"] if carrier.get("level") else []
    if kept:
        parts.append(f"Kept: {', '.join(kept)}")
    return ". ".join(parts)


def stretch_line(found: Mapping[str, float]) -> str:
    """Return the line for the report's `texture_stretch`."""
    line = f"Texture stretch: {found['p50']:.2f} at the median, {found['p95']:.2f} at the 95th percentile"
    return f"{line}; {found['above_2']:.0%} of the textured surface above 2"


def silhouettes_line(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the line for `silhouettes` of a run's summary."""
    views = (f"{each['azimuth']:g} degrees {each['iou_before']:.1%} to {each['iou']:.1%}" for each in found)
    return f"Pictures   overlap of the silhouettes: {'; '.join(views)}"


def prompt_lines(found: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line for each of the report's `prompts` that was compared with the result."""
    lines = []
    for each in found:
        if each.get("likeness") is not None:
            before = each["likeness"].get("before")
            earlier = f", {percent(before['probability'])} before" if before else ""
            where = f" (in its region{earlier})" if each["regions"] else ""
            lines.append(f"{each['prompt']}{where}: {likeness_line(each['likeness'])}")
    return lines
