"""Describe a lesson: nouns with their synonyms, and the names of files and folders of meshes. Torch-free."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from meshdeform.errors import ParameterError, PromptError, VocabularyError
from meshdeform.priors.builtin.grammar import (
    Attribute,
    Words,
    is_adjective,
    is_noun,
    noun_of,
    parse,
    part_of,
    singular_forms,
)
from meshdeform.priors.builtin.taught import MAX_NOUNS
from meshdeform.priors.builtin.vocabulary import ADJECTIVES, FILLERS
from meshdeform.vocabulary.nouns import PARTS

STATE_MAGIC = b"meshdeform-lesson-1\n"
"""First bytes of the saved state of a lesson."""
_NOUN = re.compile(r"[a-z]+(-[a-z]+){0,3}")
_LONGEST = 40
_TOLD = 10
"""Most names that an error lists."""
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


@dataclass(frozen=True)
class NewNoun:
    """A noun to teach."""

    noun: str  # canonical: small letters; several words are joined by hyphens
    synonyms: tuple[str, ...]
    replaces: bool  # whether the weights know the noun already, so that its meaning is replaced
    words: Words
    """The words of the new weights. Parts of the noun are those that its meshes are labelled with."""

    def with_parts(self, parts: Sequence[str]) -> NewNoun:
        """Return the noun with these named parts."""
        nouns = {**self.words.nouns, self.noun: tuple(part for part in PARTS if part in parts)}
        return replace(self, words=replace(self.words, nouns=nouns))


def new_noun(name: str, known: Words, *, synonyms: Sequence[str] = (), replace_known: bool = False) -> NewNoun:
    """Read the name of what is taught.

    `name`: for example "a gnome" or "teddy bear"; `known`: the words of the weights that the training starts from;
    `synonyms`: other names of the same thing; `replace_known`: whether a noun that the weights know may get a new
    meaning. Raises ParameterError: the name is no noun that a prompt could name, or it is known and may not be
    replaced.
    """
    noun = _canonical(name)
    others = tuple(dict.fromkeys(word for text in synonyms if (word := _canonical(text)) != noun))
    for word in (noun, *others):
        _check_free(word)
    named = noun_of(noun, known)
    replaces = noun in known.nouns
    if named is not None and not replaces and noun not in known.synonyms:
        replaces, noun = True, named  # a plural
    if replaces and not replace_known:
        raise ParameterError(
            f"The model knows {noun!r} already.",
            advice="Choose another name, or give the word a new meaning with --replace.",
        )
    if known_words := [word for word in others if word in known.nouns]:
        raise ParameterError(
            f"{known_words[0]!r} is a noun of its own and cannot be a synonym of {noun!r}.",
            advice="Leave this synonym out.",
        )
    if not replaces and len(known.nouns) >= MAX_NOUNS:
        raise ParameterError(
            f"The model knows {len(known.nouns)} nouns, which is the maximum.", advice="Replace one, or start anew."
        )
    # A new noun takes its name from another noun's synonyms: "cup" is a bowl until it is taught.
    names = {word: meaning for word, meaning in known.synonyms.items() if word not in (noun, *others)}
    words = Words(
        {**known.nouns, noun: ()},
        names | dict.fromkeys(others, noun),
        known.tokens if replaces else (*known.tokens, noun),
    )
    return NewNoun(noun, others, replaces, words)


def new_nouns(
    labels: Mapping[str, Collection[Attribute]],
    known: Words,
    *,
    synonyms: Sequence[str] = (),
    replace_known: bool = False,
) -> list[NewNoun]:
    """Read the names of all that a lesson teaches; the words of the last one are those of the new weights.

    `labels`: by name, what meshes are labelled with; `synonyms`: other names of the only noun. Raises ParameterError:
    as `new_noun`, for all names at once.
    """
    nouns: list[NewNoun] = []
    refused: list[ParameterError] = []
    for name, attributes in labels.items():
        words = nouns[-1].words if nouns else known
        try:
            new = new_noun(name, words, synonyms=synonyms, replace_known=replace_known)
        except ParameterError as error:
            refused.append(error)
        else:
            if any(new.noun == other.noun for other in nouns):
                raise ParameterError(f"{name!r} and {new.noun!r} are one noun.", advice="Put its meshes in one folder.")
            nouns.append(new.with_parts([attribute.part for attribute in attributes]))
    if refused:
        raise ParameterError(" ".join(error.detail for error in refused[:_TOLD]), advice=refused[0].advice_text)
    return nouns


def _canonical(name: str) -> str:
    """Return a name in small letters without its article, its words joined by hyphens."""
    words = [word for word in re.split(r"[\s-]+", name.strip().lower()) if word]
    if words[:1] and words[0] in ("a", "an", "the"):
        words = words[1:]
    noun = "-".join(words)
    if not _NOUN.fullmatch(noun) or len(noun) > _LONGEST:
        raise ParameterError(
            f"{name!r} is no noun that can be taught.",
            advice=f'Use one to four words of the letters a to z, at most {_LONGEST} letters: "a gnome".',
        )
    return noun


def _check_free(word: str) -> None:
    if word in FILLERS or is_adjective(word) or part_of(word) is not None:
        raise ParameterError(
            f"{word!r} has another role in prompts: it is an article, an adjective or a part.",
            advice="Choose another name.",
        )


def nouns_of_kit(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return the noun and the label of each file of a kit by its path: `barrels/tall/a.glb`, `TallBarrel_02.glb`.

    Folders around everything do not count. The first folder names the noun, those in it attributes; a file in no folder
    is named by the noun, and adjectives in the name are its label. Numbers and single letters do not count. Raises
    ParameterError: a name has no noun.
    """
    folders = [name.split("/")[:-1] for name in names]
    around = 0
    while len({tuple(folder[: around + 1]) for folder in folders}) == 1 and len(folders[0]) > around:
        around += 1
    kit = {}
    for name, folder in zip(names, folders, strict=True):
        title, *label = folder[around:] or [name.rpartition("/")[2].rpartition(".")[0]]
        words = [word.lower() for word in _WORD.findall(title) if len(word) > 1]
        noun = [word for word in words if not is_adjective(word)]
        if not noun:
            raise ParameterError(
                f"{title!r} does not say what {name} shows.", advice="Put it in a folder that is named by the noun."
            )
        noun[-1] = next((form for form in reversed(singular_forms(noun[-1])) if is_noun(form)), noun[-1])
        kit[name] = "-".join(noun), " ".join([*(word for word in words if is_adjective(word)), *label])
    return kit


def attributes_of_folder(name: str, new: NewNoun) -> tuple[Attribute, ...]:
    """Read the name of a folder of meshes as attributes: `tall`, `tall thin`, `long-neck`, `with_big_handle`.

    Raises ParameterError: a word of the name is no attribute, or the attributes contradict each other.
    """
    text = " ".join(re.split(r"[\s_-]+", name.strip().lower()))
    every = replace(new.words, nouns={**new.words.nouns, new.noun: tuple(PARTS)})
    words = text.split()
    sized = any(part_of(word) is not None for word in words)
    prompt = f"{new.noun} with {text}" if sized else f"{text} {new.noun}"
    try:
        attributes = parse(prompt, every).attributes
    except (PromptError, VocabularyError) as error:
        raise ParameterError(
            f"The folder {name!r} does not name attributes of a {new.noun}: {error.detail}",
            advice=f"Name it by adjectives ({', '.join(ADJECTIVES)}) or by one sized part (long neck, big handle), "
            "or give the files themselves instead of their folder.",
        ) from error
    if missing := [attribute.part for attribute in attributes if attribute.part not in new.words.tokens]:
        raise ParameterError(
            f"The folder {name!r} names a part that these weights do not know: {missing[0]}.",
            advice="Start from the weights in the package, or give the files themselves instead of their folder.",
        )
    if not attributes:
        raise ParameterError(
            f"The folder {name!r} does not name attributes of a {new.noun}.", advice="Rename it, or give its files."
        )
    return attributes
