"""Decide what a result is worth: `good`, `doubtful`, or `keep_source`, where the asset was better as it was.

A result is good if it shows what was asked for, and is whole. Whether it shows a noun, the judge says: it must have a
probability of `_SHOWN` at least among all that the judge knows, and less for the source, since else nothing is seen of
what was to change. Whether a target or pictures are met, the distance that is left says, as a share of that at the
start. Where nobody can say it, as for free text, the shape alone decides.

It is whole if its parts neither swelled nor withered against each other (`_SWOLLEN`), no figure of its structure is
much beyond its limit (`kept_structure.LIMITS`, `_TOLERATED`), and the safeguard held back little in the end.
Clay has no parts that could wither, and no walls that must stay flat: a convex source, such as a sphere or a cube, and
what is alike from all sides and becomes something that is.

Of what does not show its noun, the source is better where the noun gained no rank and a figure is beyond its limit, or
where parts swelled or withered. A fit to an exemplar must have come near it without much stretch, and is worse than the
source if it is nothing like its noun. `python -m bench.keep.blind` measures the rule on graded results.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from meshdeform.runs.kept_structure import broken
from meshdeform.runs.recognition import CROOKED
from meshdeform.verdicts import Verdict
from meshdeform.vocabulary.grammar import ParsedPrompt, parse
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUN_GROUPS, ROUND

if TYPE_CHECKING:
    from meshdeform.exemplar.outlook import FitOutlook

_SHOWN = 0.5
"""Probability of the noun from which a shape shows it."""
_UNLIKE = 16
"""Rank of the noun from which a fit is nothing like it: 6 % of members of the families, roughened, have it, as they had
8 among 149 nouns."""
_SWOLLEN = 0.7
"""Standard deviation of the logarithms of the faces' area ratios, 0 of a similarity, above which parts are seen to have
swollen or withered: by a factor of two against the mean."""
_DISTORTED = 2.0
"""The same of a fit, whose target has other proportions: mean symmetric Dirichlet energy, 1 of a similarity."""
_TOLERATED = {"asymmetry": 2.0, "flatness": 2.0, "contacts": 2.0, "cut_share": 15.0}
"""How far beyond its limit a figure may be in a good result: what exceeds it little is mostly not seen, and most cuts
of an asset of many parts are where parts meet."""
HELD_BACK = 0.2
"""Share of the surface that the safeguard held back in the end above which parts lag behind."""
UNMOVED = 0.01
"""Displacement, as a share of the diagonal, below which a result looks like its source."""
_MET, _WITHIN = 0.35, 2 / 3
"""Share of the distance at the start that may be left of what a target or pictures are met by, and share of the target
that must be within 1 % of the result."""
_ALIKE = 0.001
"""Distances to and from a target, together and as a share of the diagonal, below which nothing is left."""
_STRETCHED = 1.15
"""Factor by which an axis grew against the others from which a change in plain words says it."""
_KEPT, _LEFT, _TORN = 0.9, 0.6, 1.9
"""Of a fit to an exemplar: share of the displacement that must be left once the surface is mended, share of the
distance at the start that may be left, and mean symmetric Dirichlet energy up to which it is no other thing."""
_MOST_ADVICE = 3

_COMPARED = {
    "tall": "taller", "short": "shorter", "thin": "thinner", "fat": "fatter", "wide": "wider", "long": "longer",
    "flat": "flatter", "big": "bigger", "small": "smaller",
}  # fmt: skip

_SWELLED = "Parts of it swelled or withered against the rest."
_ANOTHER = "Try another variation: each goes its own way."
_WEAKER = "Use less strength, such as 0.6: most of what went wrong comes last."
_NEARER = "Ask for what is nearer to the asset, or for less strength, such as 0.6."
_SAID_PLAINLY = (
    "Say in plain words what differs, such as “longer”: that is made on the asset itself, which stays whole."
)
_ORDER = (Verdict.GOOD, Verdict.DOUBTFUL, Verdict.KEEP_SOURCE)


@dataclass(frozen=True)
class ShapeFigures:
    """What became of a surface, by the figures of its report."""

    structure: Mapping[str, Any]  # as `kept_structure` returns it
    swollen: bool  # whether parts swelled or withered against each other
    held: float  # `movement.held_at_end`
    moved: float  # `movement.rms`
    distortion: float = 1.0  # mean symmetric Dirichlet energy

    @classmethod
    def of(
        cls, structure: Mapping[str, Any], quality: Mapping[str, Any], movement: Mapping[str, Any], *, fitted: bool
    ) -> ShapeFigures:
        """Return the shape of a report with these members; `fitted`: to a target or pictures alone."""
        if fitted:
            swollen = quality["symmetric_dirichlet_mean"] > _DISTORTED
        else:
            swollen = quality["area_ratio_spread"] > _SWOLLEN
        return cls(structure, swollen, movement["held_at_end"], movement["rms"])

    def faults(self, excused: Collection[str] = ()) -> list[str]:
        """Return why it is not whole, in sentences; empty if it is. `excused`: figures, and `swollen`."""
        faults = [_SWELLED] if self.swollen and "swollen" not in excused else []
        faults += broken(self.structure, excused, _TOLERATED)
        if self.held > HELD_BACK:
            faults.append(f"The safeguard held back {self.held:.0%} of the surface in the end, which lags behind.")
        return faults


@dataclass(frozen=True)
class SourceAsset:
    """What is known of the asset that a prompt deformed."""

    noun: str = ""  # what it was taken for
    sure: bool = True  # whether that is what it is
    growth: tuple[float, float, float] = (1.0, 1.0, 1.0)  # the result's extents along x, y and z over the source's
    long_axis: int = 2  # 0 or 2: the longer horizontal one of the source
    convex: bool = False
    round: bool = False  # whether it is alike from all sides, so that both its mirror planes were kept


def of_noun(
    prompt: str,
    likeness: Mapping[str, Any],
    shape: ShapeFigures,
    source: SourceAsset | None = None,
    *,
    fitted: bool = False,
) -> dict[str, Any]:
    """Return the verdict of a result that should look like the prompt of the builtin prior.

    `likeness`: that of the report, with its `before`; `fitted`: to an exemplar, whose parts are not flat where those of
    the asset were, and which it must at least resemble.
    """
    reading = parse(prompt)
    known = source or SourceAsset()
    excused = _excused(reading, known) | ({"flatness"} if fitted else set())
    faults = shape.faults(excused)
    shown, why = _shown(reading, likeness)
    if shown and not faults:
        return _verdict(Verdict.GOOD, [why], shape)
    advice = _advice(reading, likeness, known, shown=shown, whole=not faults)
    damage = broken(shape.structure, excused)
    unlike = fitted and likeness["rank"] >= _UNLIKE
    if likeness["rank"] > 1 and (unlike or shape.swollen or (damage and not _gained(reading, likeness))):
        return _verdict(Verdict.KEEP_SOURCE, dict.fromkeys([why, *faults, *damage]), shape, advice)
    return _verdict(Verdict.DOUBTFUL, [*([] if shown else [why]), *faults], shape, advice)


def _excused(reading: ParsedPrompt, source: SourceAsset) -> set[str]:
    """Return what of a shape does not count: what is asked to be crooked, and what clay may do."""
    crooked = any(attribute.degree in CROOKED for attribute in reading.attributes)
    clay = source.convex or (source.round and reading.noun in ROUND)
    return {*(["asymmetry", "flatness"] if crooked else []), *(["flatness", "swollen"] if clay else [])}


def _shown(reading: ParsedPrompt, likeness: Mapping[str, Any]) -> tuple[bool, str]:
    """Return whether a result shows its noun, and why."""
    what, rank, before = ParsedPrompt(likeness["noun"]), likeness["rank"], likeness["before"]
    if rank > 1:
        other = ParsedPrompt(likeness["next"]["noun"])
        gained = "more" if _gained(reading, likeness) else "hardly more" if rank < before["rank"] else "no more"
        standing = f"number {rank} of {likeness['nouns']} nouns, where the source was {before['rank']}"
        return False, f"It looks {gained} like {what} than before ({standing}), and most like {other}."
    if before["probability"] >= _SHOWN:
        asked = " and ".join(str(attribute) for attribute in reading.attributes)
        unseen = f"; the judge does not see whether it is {asked}" if asked else ""
        return False, f"The source looked like {what} already{unseen}."
    sure = likeness["probability"] >= _SHOWN
    return sure, f"It looks {'' if sure else 'only a little '}like {what} ({likeness['probability']:.0%})."


def _gained(reading: ParsedPrompt, likeness: Mapping[str, Any]) -> bool:
    """Return whether a noun gained a rank: half of it, or, with attributes, which ranks ignore, none lost."""
    rank, was = likeness["rank"], likeness["before"]["rank"]
    return bool(rank <= was if reading.attributes else 2 * rank <= was)


def _advice(
    reading: ParsedPrompt, likeness: Mapping[str, Any], source: SourceAsset, *, shown: bool, whole: bool
) -> list[str]:
    """Return what helps, in sentences, the best first."""
    advice = []
    if source.noun and not source.sure:
        what = ParsedPrompt(source.noun)
        advice.append(f"If your asset is not {what}, say what it is with source_noun: its front depends on it.")
    advice += _plain_changes(reading, likeness, source)
    if not shown:
        advice.append(_ANOTHER)
    if not whole:
        advice.append(_WEAKER)
    return advice[:_MOST_ADVICE]


def _plain_changes(reading: ParsedPrompt, likeness: Mapping[str, Any], source: SourceAsset) -> list[str]:
    """Return the change in plain words that does as much: of the attributes, or, of a near noun, of the proportions."""
    if source.noun == reading.noun or likeness["before"]["probability"] >= _SHOWN:
        words = [_compared(attribute) for attribute in reading.attributes if attribute.degree in _COMPARED]
        return [_as_change(" and ".join(words))] if words else []
    group = next((name for name, nouns in NOUN_GROUPS.items() if source.noun in nouns), "")
    if group and reading.noun not in NOUN_GROUPS[group]:
        return [f"Ask for what is nearer to {ParsedPrompt(source.noun)}: some others of the {group} work better."]
    if not group:
        return []
    word = _proportion(source)
    return [_as_change(word) if word else _SAID_PLAINLY]


def _compared(attribute: Attribute) -> str:
    word = _COMPARED[attribute.degree]
    return word if attribute.part == "whole" else f"{word} {attribute.part}"


def _as_change(words: str) -> str:
    return f"Ask for the change alone, “{words}”: it is made on the asset itself, which stays whole."


def _proportion(source: SourceAsset) -> str:
    """Return the word for the axis that changed most against the others; empty if none did."""
    along, across = source.long_axis, 2 - source.long_axis
    names = {1: ("taller", "shorter"), along: ("longer", "shorter"), across: ("wider", "narrower")}
    mean = (source.growth[0] * source.growth[1] * source.growth[2]) ** (1 / 3)
    changes = {axis: source.growth[axis] / mean for axis in range(3)}
    axis = max(changes, key=lambda each: max(changes[each], 1 / changes[each]))
    if max(changes[axis], 1 / changes[axis]) < _STRETCHED:
        return ""
    more, less = names[axis]
    return more if changes[axis] > 1 else less


def of_prompts(prompts: Sequence[Mapping[str, Any]], shape: ShapeFigures) -> dict[str, Any]:
    """Return the verdict of a result of several prompts, by the report's `prompts`.

    None of them alone is what the result should be: of those that pull at the whole asset, one must be seen. What a
    region looks like, cut out, decides nothing.
    """
    whole = [each["likeness"] for each in prompts if each.get("likeness") and not each.get("regions")]
    seen = [likeness for likeness in whole if likeness["rank"] == 1 and likeness["probability"] >= _SHOWN]
    unseen = []
    if whole and not seen:
        nouns = " or ".join(str(ParsedPrompt(likeness["noun"])) for likeness in whole)
        unseen = [f"It does not look like {nouns}. It looks most like {ParsedPrompt(_first(whole[0]))}."]
    return _by_faults([*unseen, *shape.faults()], shape)


def _first(likeness: Mapping[str, Any]) -> str:
    """Return the noun that a result looks most like."""
    return str(likeness["noun"] if likeness["rank"] == 1 else likeness["next"]["noun"])


def of_exemplars(kept: float, shape: ShapeFigures, left: float | None = None) -> dict[str, Any]:
    """Return the verdict of fits to exemplars.

    `kept`: the share of the displacement that mending left; `left`: the share of the distance at the start that is left
    of a fit of parts; None of what has other proportions, a target or clay.
    """
    reasons = []
    if kept < _KEPT:
        reasons.append(f"It could go only {kept:.0%} of the way without breaking the surface.")
    if left is not None and left > _LEFT:
        reasons.append(f"It came hardly nearer to that shape: {left:.0%} of the distance is left.")
    if left is not None and shape.distortion > _TORN:
        reasons.append(f"It was stretched and squeezed much: {shape.distortion:.1f} on average, where 1 is not at all.")
    return _verdict(Verdict.DOUBTFUL if reasons else Verdict.GOOD, reasons, shape, [_NEARER] if reasons else [])


def of_shape_alone(left: float, shape: ShapeFigures) -> dict[str, Any]:
    """Return the verdict of a fit to a noun that the judge does not know; `left`: the share of the distance left."""
    return _by_distance(left <= _LEFT, f"{left:.0%} of the distance to that shape is left.", shape, [_NEARER])


def as_foreseen(verdict: Mapping[str, Any], outlook: FitOutlook | None) -> dict[str, Any]:
    """Return a verdict with what there was to expect of a fit, where that was doubtful, and what to ask for instead."""
    if outlook is None or not outlook.doubtful:
        return dict(verdict)
    instead = " or ".join(f"“{prompt}”" for prompt in outlook.suggestions)
    advice = [*([f"Ask for what it can become: {instead}."] if instead else []), *verdict["advice"]]
    reasons = list(dict.fromkeys([*verdict["reasons"], *outlook.reasons]))
    return {**verdict, "reasons": reasons, "advice": advice[:_MOST_ADVICE]}


def of_target(fit: Mapping[str, Any], shape: ShapeFigures) -> dict[str, Any]:
    """Return the verdict of a fit to a mesh, by the report's `fit`."""
    before, after = (each["to_target"] + each["from_target"] for each in (fit["before"], fit))
    left = after / before if after > _ALIKE else 0.0
    found = f"{left:.0%} of the distance to the target is left, and {fit['within']:.0%} of the target is within 1 %."
    advice = [
        "Name places that belong together (landmarks), and turn the target as the asset is.",
        "Choose a target whose shape is nearer to the asset's.",
    ]
    return _by_distance(left <= _MET and fit["within"] >= _WITHIN, found, shape, advice)


def of_pictures(silhouettes: Sequence[Mapping[str, Any]], shape: ShapeFigures) -> dict[str, Any]:
    """Return the verdict of a fit to pictures, by the report's `silhouettes`."""
    before = sum(1 - each["iou_before"] for each in silhouettes)
    left = sum(1 - each["iou"] for each in silhouettes) / before if before > 0 else 0.0
    overlaps = ", ".join(f"{each['iou']:.0%}" for each in silhouettes)
    found = f"{left:.0%} of what the silhouettes lacked is left; they overlap by {overlaps}."
    return _by_distance(left <= _MET, found, shape, ["Check the azimuth of each picture, or give a further one."])


def _by_distance(met: bool, found: str, shape: ShapeFigures, advice: Sequence[str]) -> dict[str, Any]:
    faults = shape.faults()
    if met and not faults:
        return _verdict(Verdict.GOOD, [found], shape)
    value = Verdict.KEEP_SOURCE if shape.swollen and not met else Verdict.DOUBTFUL
    return _verdict(value, [found, *faults], shape, [*([] if met else advice), *([_WEAKER] if faults else [])])


def of_shape(shape: ShapeFigures) -> dict[str, Any]:
    """Return the verdict of a result of which nobody can say what it looks like: by its shape alone."""
    return _by_faults(shape.faults(), shape)


def _by_faults(faults: Sequence[str], shape: ShapeFigures) -> dict[str, Any]:
    """Return the verdict of a result that is good unless something speaks against it."""
    if shape.moved < UNMOVED:
        faults = [*faults, f"It hardly moved: {shape.moved:.1%} of its size."]
    if not faults:
        return _verdict(Verdict.GOOD, ["Nothing broke. Whether it looks as you meant, you see best."], shape)
    return _verdict(Verdict.DOUBTFUL, faults, shape, [_ANOTHER, *([_WEAKER] if shape.faults() else [])])


def verdict_of_change(
    structure: Mapping[str, Any], reasons: Sequence[str] = (), *, of_parts: bool = False
) -> dict[str, Any]:
    """Return the verdict of a change in plain words: good unless something broke, or other `reasons` speak against it.

    Asymmetry and bent pieces are what some changes ask for; only flipped faces, new cuts and cracks count. `of_parts`:
    whether only parts were changed, which enter those beside them where they grow.
    """
    tolerated = {"cut_share": _TOLERATED["cut_share"]} if of_parts else {}
    broke = broken(structure, frozenset(structure) - {"flipped_faces", "cut_share", "opened_junctions"}, tolerated)
    if not broke and not reasons:
        said = {"value": Verdict.GOOD.value, "reasons": ["Nothing broke."], "advice": []}
    else:
        advice = ["Ask for less of it, such as “slightly”."] if broke else []
        said = {"value": Verdict.DOUBTFUL.value, "reasons": [*reasons, *broke], "advice": advice}
    return {**said, "structure": dict(structure)}


def worst(verdicts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return one verdict of several guidances of a run: the worst value, with all reasons and advice."""
    last = max(verdicts, key=lambda each: _ORDER.index(Verdict(each["value"])))
    gathered = {
        name: list(dict.fromkeys(text for each in verdicts for text in each[name])) for name in ("reasons", "advice")
    }
    return {**last, **gathered}


def _verdict(value: Verdict, reasons: Iterable[str], shape: ShapeFigures, advice: Iterable[str] = ()) -> dict[str, Any]:
    return {
        "value": value.value,
        "reasons": list(reasons),
        "advice": list(advice),
        "structure": dict(shape.structure),
    }
