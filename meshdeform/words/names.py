"""Say which nouns and synonyms a word of one's own can have, and whether two words are one. Torch-free, numpy-free."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from meshdeform.errors import ParameterError
from meshdeform.vocabulary.lookup import WORDS, Words, is_adjective, noun_of
from meshdeform.vocabulary.words import FILLERS, INTENSIFIERS, NUMBERS
from meshdeform.words.file import NAME, Word
from meshdeform.words.limits import MAX_NAME, MAX_SYNONYMS

__all__ = ["check_names", "read_like", "read_name", "vocabulary"]


def read_name(text: str, member: str = "noun") -> str:
    """Return a noun or a synonym as words have it: "Dragon Fruit" is `dragon-fruit`.

    Raises
    ------
    ParameterError
        At this member of a request: it is no noun, or a word that prompts have for something else.
    """
    name = "-".join(text.lower().replace("-", " ").replace("_", " ").split())
    if not NAME.fullmatch(name) or len(name) > MAX_NAME:
        raise ParameterError.at(
            [member], f"{text[:80]!r} is no name for a word.", f"Use letters a to z, at most {MAX_NAME}: dragon-fruit."
        )
    if name in FILLERS | INTENSIFIERS | NUMBERS or is_adjective(name):
        raise ParameterError.at([member], f"{name!r} has another meaning in prompts.", "Choose the name of a thing.")
    return name


def read_like(text: str) -> str:
    """Return the noun of ours that a text means; empty for none.

    Raises ParameterError: at `like`: ours has no such noun.
    """
    found = noun_of(read_name(text, "like"), WORDS) if text else ""
    if found is None:
        raise ParameterError.at(["like"], f"{text[:80]!r} is no noun of ours.", "Leave it out, or name one of ours.")
    return found


def check_names(noun: str, synonyms: Sequence[str], others: Iterable[Word], *, replace: bool = False) -> None:
    """Refuse names of a word, as `read_name` returns them, that are ours, or another word's of the same owner.

    `others`: the owner's words. `replace`: whether the noun may be one of ours, which it then replaces for its owner,
    or that of the word which it takes the place of.

    Raises
    ------
    ParameterError
        Two nouns would be one, also by a plural or a synonym; or there are too many synonyms.
    """
    if len(synonyms) > MAX_SYNONYMS:
        raise ParameterError.at(["synonyms"], f"A word has at most {MAX_SYNONYMS} synonyms.", "Leave some out.")
    if noun_of(noun, WORDS) is not None and not replace:
        advice = "Choose another noun, or replace ours for yourself (--replace; at a service, `replace`)."
        raise ParameterError.at(["noun"], _builtin_detail(noun), advice)
    for name in synonyms:
        if noun_of(name, WORDS) not in (None, noun):
            raise ParameterError.at(["synonyms"], _builtin_detail(name), "Leave this synonym out.")
    for other in others:
        if other.noun == noun:
            if replace:
                continue
            raise ParameterError.at(
                ["noun"],
                f"You have the word {noun!r}.",
                "Choose another noun, or replace it (--replace; at a service, `replace`).",
            )
        _check_apart(noun, synonyms, other)


def _builtin_detail(name: str) -> str:
    """Return a sentence about a name that is read as a noun of ours."""
    noun = noun_of(name, WORDS)
    return f"{name!r} is a noun of ours." if name == noun else f"{name!r} is read as our {noun!r}."


def _check_apart(noun: str, synonyms: Sequence[str], other: Word) -> None:
    """Refuse names that are read as another word, or one of whose names would be read as this."""
    own = Words({noun: ()}, dict.fromkeys(synonyms, noun), ())
    theirs = Words({other.noun: ()}, dict.fromkeys(other.synonyms, other.noun), ())
    clash = next((name for name in (noun, *synonyms) if noun_of(name, theirs)), None)
    clash = clash or next((name for name in (other.noun, *other.synonyms) if noun_of(name, own)), None)
    if clash is not None:
        member = "noun" if noun_of(clash, Words({noun: ()}, {}, ())) else "synonyms"
        raise ParameterError.at(
            [member],
            f"{noun!r} and your word {other.noun!r} would be one: {clash!r} is read as both.",
            f"Choose other names, or remove {other.noun!r} first.",
        )


def vocabulary(words: Iterable[Word], parts_of: dict[str, tuple[str, ...]]) -> Words:
    """Return the nouns of the builtin prior and these words; `parts_of`: whose size a prompt can set, by noun."""
    own = {word.noun: word for word in words}
    synonyms = {name: noun for name, noun in WORDS.synonyms.items() if name not in own}
    synonyms |= {name: word.noun for word in own.values() for name in word.synonyms}
    return Words({**WORDS.nouns, **{noun: parts_of.get(noun, ()) for noun in own}}, synonyms, ())
