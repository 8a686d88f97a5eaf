"""Check the prompts of a request against the words of the builtin prior or of taught weights. Torch-free."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from meshdeform.errors import PromptError, VocabularyError

if TYPE_CHECKING:
    from meshdeform.priors.builtin.words import Words
    from meshdeform.requests.document import DeformParams

__all__ = ["PlacedPrompt", "at_parameter", "check_vocabulary"]

PlacedPrompt = tuple[list[str | int], str]
"""A prompt after its place in the document."""


def check_vocabulary(prompts: Sequence[PlacedPrompt], params: DeformParams, known: Words) -> None:
    """Refuse prompts that the builtin prior with these words cannot read.

    Raises
    ------
    PromptError, VocabularyError
        One of them, or the negative prompt; of several prompts the error says which.
    """
    from meshdeform.priors.builtin.grammar import parse, parse_negative

    for place, prompt in prompts:
        try:
            parse(prompt, known)
        except (PromptError, VocabularyError) as error:
            if len(prompts) > 1:  # say which
                error.extra |= {"errors": [{"loc": place, "msg": error.detail, "type": "value_error"}]}
            raise
        if params.negative_prompt.strip():
            try:
                parse_negative(params.negative_prompt, prompt, known)
            except (PromptError, VocabularyError) as error:
                # Add which of the two texts the error is about.
                error.extra |= at_parameter("negative_prompt", error.detail)
                raise


def at_parameter(name: str, detail: str) -> dict[str, Any]:
    """Return the member of a problem document that names a parameter."""
    return {"errors": [{"loc": ["params", name], "msg": detail, "type": "value_error"}]}
