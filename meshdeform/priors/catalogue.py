"""Describe the models of a deployment: availability and vocabulary. Needs no torch."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from meshdeform.errors import MeshdeformError
from meshdeform.priors import check_model, hidden_folders, public_names
from meshdeform.priors.builtin.vocabulary import NOUNS as PRIOR_NOUNS
from meshdeform.priors.builtin.vocabulary import PRIOR_ATTRIBUTES
from meshdeform.requests.choices import is_weights_file
from meshdeform.requests.document import BUILTIN_MODEL
from meshdeform.vocabulary.lookup import ATTRIBUTES
from meshdeform.vocabulary.nouns import NOUN_GROUPS, NOUNS

EXAMPLES: tuple[str, ...] = (
    "a mushroom with a big cap",
    "a tall vase",
    "a giraffe with a long neck",
    "a fat penguin",
    "a rabbit with big ears",
    "a twisted bottle",
)
"""Example prompts for the builtin prior."""

_GUIDES = "A Stable Diffusion checkpoint: takes any prompt in English. A GPU is recommended."
_WEIGHTS = "The builtin model with other weights."
_CARD = 10_000
"""Characters of a model card that are read."""
_GROUPS = {group: tuple(noun for noun in nouns if noun in PRIOR_NOUNS) for group, nouns in NOUN_GROUPS.items()}
OWN_GROUP = "yours"
"""The group of words of one's own."""


@dataclass(frozen=True)
class Vocabulary:
    """Vocabulary of a model, if it is limited."""

    nouns: tuple[str, ...]  # the things that the model can make; a prompt names one
    attributes: tuple[str, ...]  # attributes of things and of their parts: `tall`, `long neck`
    parts: dict[str, tuple[str, ...]]  # by noun, the parts that attributes may name
    examples: tuple[str, ...]  # prompts that the model accepts
    groups: dict[str, tuple[str, ...]]  # the nouns by kind: animals, vehicles, furniture


_VOCABULARY = Vocabulary(
    tuple(PRIOR_NOUNS),
    tuple(map(str, PRIOR_ATTRIBUTES)),
    dict(PRIOR_NOUNS),
    EXAMPLES,
    {group: nouns for group, nouns in _GROUPS.items() if nouns},
)


@dataclass(frozen=True)
class ModelInfo:
    """A model that jobs may name."""

    id: str  # value of `params.guidance.model`
    # Human-readable texts
    title: str
    description: str
    available: bool | None
    """Whether the model can be loaded on this machine. None if jobs run elsewhere, so this is unknown."""
    problem: str | None  # why the model is not available, and what to do
    vocabulary: Vocabulary | None  # none if the model takes any prompt
    licence: str = ""  # what its model card says, or an empty text


def shapes_vocabulary(own: Mapping[str, tuple[str, ...]]) -> Vocabulary:
    """Return what there are shapes of, which prompts name where no model is asked.

    `own`: words of one's own, which come first, with the parts whose size a prompt can set.
    """
    nouns = {**own, **{noun: parts for noun, parts in NOUNS.items() if noun not in own}}
    groups = {group: tuple(noun for noun in some if noun not in own) for group, some in NOUN_GROUPS.items()}
    groups = {**({OWN_GROUP: tuple(own)} if own else {}), **groups}
    return Vocabulary(tuple(nouns), tuple(map(str, ATTRIBUTES)), nouns, EXAMPLES, groups)


def list_models(
    default_model: str, allowed_models: Sequence[str] = (), revision: str = "", *, public: bool = False
) -> list[ModelInfo]:
    """Return every model that jobs of a deployment may name, the default one first.

    `allowed_models`: models that jobs may name besides the default one and `builtin`; `public`: whether the list is for
    clients, which see a folder's id instead of its path.
    """
    models = list(dict.fromkeys([default_model, BUILTIN_MODEL, *allowed_models]))
    ids = public_names(models) if public else {model: model for model in models}
    return [_describe(model, ids[model], revision if model == default_model else "") for model in models]


def _describe(model: str, name: str, revision: str) -> ModelInfo:
    if model == BUILTIN_MODEL:
        return ModelInfo(
            id=model,
            title="Builtin",
            description=f"The small demonstration model that is included: {len(PRIOR_NOUNS)} things and their "
            "attributes, in seconds to minutes on any machine, without a download.",
            available=True,
            problem=None,
            vocabulary=_VOCABULARY,
            licence="Apache-2.0",
        )
    of_builtin = is_weights_file(model)
    available, problem = _find(model, revision, [model] if name != model else [])
    return ModelInfo(
        id=name,
        # The name is the last part of a folder's path or a hub id.
        title=model.rstrip("/").rpartition("/")[2] or model,
        description=_WEIGHTS if of_builtin else _GUIDES,
        available=available,
        problem=problem,
        vocabulary=_VOCABULARY if of_builtin and available else None,
        licence=_licence(model),
    )


def _licence(model: str) -> str:
    """Return the licence that the model card in a folder states; empty if it is not known."""
    try:
        with (Path(model).expanduser() / "README.md").open(encoding="utf-8") as card:
            head = card.read(_CARD)
    except (OSError, ValueError):
        return ""
    match = re.search(r"^license:[ \t]*([\w.+-]{1,60})[ \t]*$", head, re.MULTILINE)
    return match[1] if match and head.startswith("---") else ""


def _find(model: str, revision: str, hidden: Sequence[str]) -> tuple[bool | None, str | None]:
    if importlib.util.find_spec("torch") is None:
        return None, None  # this environment does not run models; the worker may have it
    try:
        with hidden_folders(hidden):
            check_model(model, revision)
    except MeshdeformError as error:
        return False, f"{error.detail} {error.advice_text}"
    return True, None
