"""Say whether a prompt is a change in plain words ("longer legs"), and whether an asset has its parts. Torch-free.

A prompt without a noun is a change, and so is one that compares ("a fatter dog"). A description ("a fat dog") is one if
the source is that noun, as the request says (`source_noun`) or the run recognises.

A child process is asked for parts, which are found with numpy and scipy: an API need not have these.
"""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.assets.limits import Limits
from meshdeform.errors import (
    DependencyError,
    ParameterError,
    PartNotFoundError,
    PromptError,
    UnavailableError,
    VocabularyError,
)
from meshdeform.plain.table import OF_PARTS, WHOLE
from meshdeform.plain.wording import says_change
from meshdeform.plain.words import Sentence, described, read_changes
from meshdeform.requests.choices import GuidanceKind, PartsAs, is_builtin
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.runs.kept_readings import Readings
from meshdeform.runs.questions import Question
from meshdeform.runs.read_questions import ask_about, loaded, with_words
from meshdeform.vocabulary.grammar import ParsedPrompt, parse
from meshdeform.vocabulary.looks import SHAPES
from meshdeform.vocabulary.lookup import noun_of
from meshdeform.words import words_in_use

if TYPE_CHECKING:
    from meshdeform.assets import Asset
    from meshdeform.plain.body import Body

_SHOWN = 20
_UNUSED = ("regions", "rigid", "handles")
_QUESTION = Question(
    "parts",
    cannot="The parts of the asset cannot be found on this server.",
    lacks="Parts are found with the extra `deform`, which the API of this server lacks",
    instead="Send the job without asking before.",
)


def asked_changes(prompt: str, params: ResolvedParams) -> Sentence | None:
    """Return the changes that a prompt asks for; None if something else guides, or it asks for none."""
    fitted = params.guidance is GuidanceKind.EXEMPLAR
    alone = not params.prompts and not params.silhouettes and (fitted or params.guidance is GuidanceKind.SDS)
    if not alone or not prompt:
        return None
    changes = read_changes(prompt, noun_of)
    is_thing = changes is not None and changes.noun is None and not changes.compared and _names_thing(prompt)
    if fitted or is_builtin(params.model):
        reading = _parsed(prompt, tuple(word.sha256 for word in words_in_use()))
        of_part = changes is not None and changes.noun is None and not is_thing
        return changes if reading is None or of_part else _described(reading, changes)
    # Other models read free text: theirs is every prompt that names a thing.
    return (
        changes if changes is not None and changes.noun is None and changes.names_known_parts and not is_thing else None
    )


def _names_thing(prompt: str) -> bool:
    """Return whether a word is a noun itself, and not only the name of a part: "a tall door", "a big skull"."""
    return any(noun_of(word) == word for word in re.findall(r"[a-z]+", prompt.lower()))


@lru_cache(maxsize=64)
def _parsed(prompt: str, _words: tuple[str, ...]) -> ParsedPrompt | None:
    """Return the meaning of a prompt, in any of its languages; None if it is none.

    `_words`: the words of somebody's own that are known, on which the answer depends.
    """
    try:
        return parse(prompt)
    except (PromptError, VocabularyError):
        return None


def _described(reading: ParsedPrompt, changes: Sentence | None) -> Sentence | None:
    """Return the changes that a prompt describes; None if it has none, or some that only a fit can make.

    `changes`: how it is read as a change, which also has amounts; it counts if it says as much of the same noun.
    """
    attributes = [(each.part, each.degree) for each in reading.attributes]
    if not attributes or reading.borrowed or any(degree in SHAPES for _, degree in attributes):
        return None
    if changes is None or changes.noun != reading.noun or len(changes.changes) != len(attributes):
        changes = described(reading.noun, attributes)
    return replace(changes, notes=tuple(dict.fromkeys([*changes.notes, *reading.notes])))


def is_change(sentence: Sentence) -> bool:
    """Return whether changes are a change whatever the asset is."""
    return sentence.noun is None or sentence.compared


def refuse_unread_change(prompt: str, error: VocabularyError) -> None:
    """Raise VocabularyError: a prompt that is no known prompt compares or commands, so that a change was meant."""
    if says_change(prompt, noun_of):
        raise VocabularyError(
            f"{prompt!r} is read as a change in plain words, and not all of it is understood.",
            advice="Changes are such as: longer legs, a bigger head, 20 % taller, lower the seat. Nothing is added, "
            "removed or turned.",
            **error.extra,
        ) from error


def has_controls(params: ResolvedParams) -> bool:
    """Return whether parameters have controls that a change in plain words does not have."""
    return any(getattr(params, name) for name in _UNUSED)


def check_change(params: ResolvedParams) -> None:
    """Refuse controls that a change in plain words does not have."""
    for name in _UNUSED:
        if getattr(params, name):
            raise ParameterError.at(
                ["params", "control", name],
                f"The prompt is a change in plain words, which has no {name}.",
                f"Leave params.control.{name} out, or describe a thing in the prompt: a tall vase.",
            )


def part_names(body: Body, params: ResolvedParams | None = None) -> list[str]:
    """Return the parts that the prompt of a job can name on a body; by default it has the builtin prior."""
    from meshdeform.plain.naming import find_parts

    read = partial(asked_changes, params=params or resolve(DeformParams()))
    return [part.name for part in find_parts(body, read)]


def parts_found(body: Body, params: ResolvedParams) -> list[dict[str, Any]]:
    """Return the parts that the prompt of a job can name on a body: `name`, `found_by` and `confidence` of each."""
    from meshdeform.plain.naming import find_parts

    found = find_parts(body, partial(asked_changes, params=params))
    return [{"name": each.name, "found_by": each.found_by, "confidence": each.confidence} for each in found]


def part_not_found(reason: str, parts: list[str], taken_for: str = "") -> PartNotFoundError:
    """Return the error about a part that is not there.

    `parts` are those that were found; `taken_for`: the noun of a description, if the asset was recognised as that.
    """
    more = f" and {len(parts) - _SHOWN} more" if len(parts) > _SHOWN else ""
    listed = f"Parts found: {', '.join(parts[:_SHOWN])}{more}." if parts else "No part was found."
    advice = "Name one of these, or the whole: taller, wider, fatter. `meshdeform inspect` lists the parts."
    if taken_for:
        advice += f" The asset was taken for {ParsedPrompt(taken_for)}: if it is none, say by source_noun what it is."
    return PartNotFoundError(f"{reason} {listed}", advice=advice, parts=parts)


def check_parts(
    asset: Path,
    filename: str,
    prompt: str,
    params: ResolvedParams,
    limits: Limits,
    readings: Readings | None = None,
) -> None:
    """Refuse a change of a part that an asset lacks, in a child process; a machine that cannot tell accepts it.

    `readings`: where readings of assets are kept.
    """
    sentence = asked_changes(prompt, params)
    if sentence is None or all(each.part == WHOLE for each in sentence.changes):
        return
    if not is_change(sentence) and sentence.noun != params.source_noun:
        return  # whether it is one, the run finds out
    try:
        answer = ask_about(_QUESTION, asset, filename, params, limits, readings, prompt=prompt, only_check=True)
    except (DependencyError, UnavailableError):
        return  # the run refuses it
    if answer["missing"] is not None:
        raise part_not_found(answer["missing"], answer["parts"])


def parts_of(
    asset: Path,
    filename: str,
    prompt: str,
    params: ResolvedParams,
    limits: Limits,
    readings: Readings | None = None,
    *,
    glb: PartsAs | None = None,
) -> dict[str, Any]:
    """Return the parts of an asset that prompts can name, or those that a prompt names and what it makes of the asset.

    `filename`: its name; the extension decides the format where the content does not; `readings`: where readings of
    assets are kept. Returns `reading`, as `runs.reading.reading_document` has it, or None if the asset cannot be read;
    `parts`, each with its `name`, `found_by`, `confidence`, `faces` as regions have them, and `changes`: an
    `operation`, and words for `more` and for `less` of it. `result` is a GLB in base64, or None if the prompt is no
    change, and `warnings` say what of it is less than was asked for. With `glb`, the result has the parts in this form,
    also that of no prompt.
    """
    asked_changes(prompt, params)  # what it refuses
    answer = ask_about(_QUESTION, asset, filename, params, limits, readings, prompt=prompt, glb=glb)
    missing = answer.pop("missing")
    if missing is not None:
        raise part_not_found(missing, answer["parts"])
    return answer


def find_parts_asked(task: dict[str, Any]) -> dict[str, Any]:
    """Return which part is missing, or all parts and what becomes of them, in the child."""
    with with_words(task):
        return _answer(task)


def _answer(task: dict[str, Any]) -> dict[str, Any]:
    from meshdeform.plain.change import missing_part

    asset, body, params = loaded(task)
    if "only_check" not in task:
        return _parts_answer(asset, body, task["prompt"], params, task["glb"])
    sentence = asked_changes(task["prompt"], params)
    missing = None if sentence is None else missing_part(body, sentence)
    return {"missing": missing, "parts": [] if missing is None else part_names(body, params)}


def _parts_answer(asset: Asset, body: Body, prompt: str, params: ResolvedParams, glb: PartsAs | None) -> dict[str, Any]:
    from meshdeform.plain.change import apply_changes, meant
    from meshdeform.plain.naming import find_parts
    from meshdeform.plain.pieces import PartMissingError
    from meshdeform.runs.parted import result_with_parts
    from meshdeform.runs.reading import reading_document

    corners, read = body.vertex_map[asset.surface.triangles], partial(asked_changes, params=params)
    sentence = read(prompt)
    if prompt and (sentence is None or not is_change(sentence)):
        return {"reading": None, "parts": [], "missing": None, "result": None, "warnings": []}
    document: dict[str, Any] = {"reading": None, "parts": [], "missing": None, "result": None, "warnings": []}
    if sentence is not None:
        try:
            changed, done = apply_changes(body, meant(body, sentence))
        except PartMissingError as missing:
            return {**document, "missing": str(missing), "parts": part_names(body, params)}
        moved, used = asset.surface.positions.copy(), body.vertex_map >= 0
        moved[used] += (changed.points - body.points)[body.vertex_map[used]]
        document["result"] = base64.b64encode(asset.replace(moved, compact=True)).decode()
        document["warnings"] = [*sentence.notes, *(said for each in done for said in [*each.warnings, *each.doubts])]
        if glb is None and all(each.change.part == WHOLE for each in done):  # which needs no reading
            return document
    found = find_parts(body, read, sentence)
    document["parts"] = [
        {
            "name": part.name,
            "found_by": part.found_by,
            "confidence": part.confidence,
            "faces": part.faces(corners),
            "changes": [
                {"operation": each, "more": OF_PARTS[each][0], "less": OF_PARTS[each][1]} for each in part.operations
            ],
        }
        for part in found
    ]
    if glb is not None:
        document["result"] = result_with_parts(asset, document["result"], PartsAs(glb), body, found)
    # Parts that the file names need no reading.
    reading = body.reader.reading if not prompt else body.reader.made
    document["reading"] = reading_document(reading, params)
    return document
