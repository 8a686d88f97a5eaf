"""Say whether a prompt is a change in plain words ("longer legs"), and whether an asset has its parts. Torch-free.

A prompt without a noun is a change, and so is one that compares ("a fatter dog"). A description ("a fat dog") is one if
the source was recognised as that noun, which only the run knows.

`missing_part` asks a child process, since parts are found with numpy and scipy, which an API need not have.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from meshdeform.assets.limits import Limits
from meshdeform.errors import DependencyError, ParameterError, PartNotFoundError, UnavailableError
from meshdeform.plain.words import WHOLE, Sentence, read_changes
from meshdeform.priors.builtin.grammar import noun_of
from meshdeform.requests.choices import GuidanceKind, is_builtin
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.questions import Question, answer

_SHOWN = 20
_TIMEOUT_S = 60.0
_UNUSED = ("regions", "rigid", "handles")
_QUESTION = Question(
    __name__,
    cannot="The parts of the asset cannot be found on this server.",
    lacks="Parts are found with the extra `deform`, which the API of this server lacks",
    instead="Send the job without asking before.",
)


def asked_changes(prompt: str, params: ResolvedParams) -> Sentence | None:
    """Return the changes that a prompt asks for; None if something else guides, or it asks for none.

    Raises
    ------
    PromptError
        It asks for opposite changes, or for too much.
    """
    alone = not params.prompts and not params.silhouettes and params.guidance is GuidanceKind.SDS
    if not alone or not prompt:
        return None
    found = read_changes(prompt, noun_of)
    if found is None or is_builtin(params.model):
        return found
    # Other models read free text: theirs is every prompt that names a thing.
    return found if found.noun is None and found.known else None


def is_change(sentence: Sentence) -> bool:
    """Return whether changes are a change whatever the asset is."""
    return sentence.noun is None or sentence.compared


def check_change(params: ResolvedParams) -> None:
    """Refuse controls that a change in plain words does not have.

    Raises
    ------
    ParameterError
    """
    for name in _UNUSED:
        if getattr(params, name):
            raise ParameterError.at(
                ["params", "control", name],
                f"The prompt is a change in plain words, which has no {name}.",
                f"Leave params.control.{name} out, or describe a thing in the prompt: a tall vase.",
            )


def part_not_found(reason: str, parts: list[str]) -> PartNotFoundError:
    """Return the error about a part that is not there; `parts` are those that were found."""
    more = f" and {len(parts) - _SHOWN} more" if len(parts) > _SHOWN else ""
    listed = f"Parts found: {', '.join(parts[:_SHOWN])}{more}." if parts else "No part was found."
    return PartNotFoundError(
        f"{reason} {listed}",
        advice="Name one of these, or the whole: taller, wider, fatter. `meshdeform inspect` lists the parts.",
        parts=parts,
    )


def check_parts(asset: Path, filename: str, prompt: str, params: ResolvedParams, limits: Limits) -> None:
    """Refuse a change of a part that an asset lacks, in a child process; a machine that cannot tell accepts it.

    Raises
    ------
    PartNotFoundError
    """
    sentence = asked_changes(prompt, params)
    if sentence is None or not is_change(sentence) or all(each.part == WHOLE for each in sentence.changes):
        return
    task = {
        "asset": str(asset.absolute()),
        "filename": f"asset{Path(filename).suffix[:16]}",
        "changes": [asdict(change) for change in sentence.changes],
        "exclude": list(params.exclude),
        "limits": asdict(limits),
    }
    try:
        found = _QUESTION.ask([json.dumps(task)], asset.absolute().parent, _TIMEOUT_S)
    except (DependencyError, UnavailableError):
        return  # the run refuses it
    if found["missing"] is not None:
        raise part_not_found(found["missing"], found["parts"])


def main(arguments: list[str] | None = None) -> int:
    """Print a JSON verdict that says which part of a task an asset lacks."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("task", type=json.loads)
    return answer(partial(_missing, parser.parse_args(arguments).task))


def _missing(task: dict[str, Any]) -> dict[str, Any]:
    from meshdeform.assets import load_asset
    from meshdeform.plain.body import loose_body
    from meshdeform.plain.change import list_parts, missing_part
    from meshdeform.plain.words import Change
    from meshdeform.requests.selection import find_excluded

    asset = load_asset(Path(task["asset"]).read_bytes(), task["filename"], Limits(**task["limits"]))
    body = loose_body(asset.without(find_excluded(task["exclude"], asset.parts().nodes)))
    missing = missing_part(body, [Change(**change) for change in task["changes"]])
    return {"missing": missing, "parts": [] if missing is None else list_parts(body)}
