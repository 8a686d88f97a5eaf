"""Make words of meshes, or take them from a file, and keep them: all of a request, or none."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from meshdeform.api.documents import WordList, WordView
from meshdeform.assets.limits import Limits
from meshdeform.errors import ParameterError, UnavailableError, readable_size
from meshdeform.kinds.words.process import made_word
from meshdeform.kinds.words.routes.documents import WordDocument
from meshdeform.record.words import KeptWord, NewWord
from meshdeform.runs.kept_readings import samples_in
from meshdeform.words import Word, WordOffer, check_names, read_like, read_name, read_words
from service.http.forms import ReceivedFile
from service.http.idempotency import Caller, KeptAnswer, claimed, request_hash
from service.jobs.intake import fetch, store_file
from service.state import AppState
from service.words.known import as_word

MESHES, WORD = "meshes", "word"
"""The fields of meshes, and of a file of words."""


def add_words(
    app: AppState, caller: Caller, document: WordDocument, files: Mapping[str, ReceivedFile], folder: Path
) -> KeptAnswer:
    """Make the word of a request, or take those of its file, and keep them; nothing is kept if anything is wrong."""
    body = document.model_dump(mode="json", exclude_unset=True)
    digests = {name: file.sha256 for name, file in files.items()}
    with claimed(app.record, caller, request_hash(caller.method, caller.path, body, digests)) as claim:
        if isinstance(claim, KeptAnswer):
            return claim
        answers: list[KeptAnswer] = []

        def record_answer(connection: sa.Connection, kept: list[KeptWord]) -> None:
            words = WordList(words=[WordView(**view_members(each)) for each in kept])
            answers.append(KeptAnswer(201, words.as_json(), {"Cache-Control": "no-store"}))
            if claim is not None:
                app.record.idempotency.complete(claim, answers[0].kept(), connection)

        words = _words(app, caller.owner_id, document, files, folder)
        with app.record.files.leases() as leases:
            stored = [store_file(app, leases, _file(word, folder)) for word in words]
            new = [
                NewWord(word.noun, word.sha256, file.key, file.size, word.told, word.faces)
                for word, file in zip(words, stored, strict=True)
            ]

            def check(before: list[KeptWord]) -> None:
                _check_names(app, before, [(word.noun, word.synonyms) for word in words], document)
                _check_bytes(app, before, new)

            old = app.record.words.put(caller.owner_id, new, check=check, also=record_answer)
            leases.passed_on([file.key for file in stored])
        remove_contents(app, old)
        return answers[0]


def remove_contents(app: AppState, keys: Sequence[str]) -> None:
    """Remove contents that no word and no job needs any more; if the store does not answer, the reconciler does."""
    with suppress(UnavailableError):
        for key in keys:
            app.record.files.remove_unused(key, app.store.delete)


def view_members(kept: KeptWord) -> dict[str, Any]:
    """Return the members of a word's document."""
    return {
        **{name: value for name, value in kept.told.items() if name != "shapes"},
        "meshes": len(kept.faces),
        "faces": sum(kept.faces),
        "size": kept.size,
        "sha256": kept.sha256,
        "created_at": kept.created_at,
    }


def _words(
    app: AppState, owner_id: str, document: WordDocument, files: Mapping[str, ReceivedFile], folder: Path
) -> list[Word]:
    """Return the words of a request, whose names are checked before anything is made."""
    file, before = files.get(WORD), app.record.words.all(owner_id)
    if file is not None:
        if document.model_fields_set - {"replace"} or len(files) > 1:
            raise ParameterError.at([WORD], "A file of words has all that it says.", "Send nothing but it and replace.")
        app.assets.check(file.path, file.filename, file.sha256, owner_id, "words")
        words = read_words(file.path.read_bytes())
        _check_names(app, before, [(word.noun, word.synonyms) for word in words], document)
        return words
    noun, synonyms = read_name(document.noun), tuple(read_name(each, "synonyms") for each in document.synonyms)
    like = read_like(document.like)
    _check_names(app, before, [(noun, synonyms)], document)
    named = {str(number): each for number, each in enumerate(document.meshes)}
    sent = [
        *files.values(),
        *(fetch(app, owner_id, each, [MESHES, number], folder) for number, each in named.items()),
    ]
    if not sent:
        raise ParameterError.at([MESHES], "There is no mesh.", f"Send one or more as the field `{MESHES}`.")
    offer = WordOffer(noun, synonyms, like, document.front, document.fronts, document.licence)
    limits, samples = Limits.from_settings(app.settings), samples_in(app.settings.cache_folder)
    return [made_word(offer, _named(sent), folder, limits, samples)]


def _check_names(
    app: AppState, before: Sequence[KeptWord], added: Sequence[tuple[str, Sequence[str]]], document: WordDocument
) -> None:
    """Refuse nouns with synonyms that are not free beside the owner's words, or one more than there may be."""
    kept, limit = {each.noun: as_word(each) for each in before}, app.settings.max_words
    for noun, synonyms in added:
        check_names(noun, synonyms, kept.values(), replace=document.replace)
        kept[noun] = Word(noun, tuple(synonyms), "", (), (), (), b"")
    if len(kept) > limit:
        raise ParameterError(
            f"There would be {len(kept)} words, and {limit} can be kept.", advice="Delete some.", limit=limit
        )


def _check_bytes(app: AppState, before: Sequence[KeptWord], added: Sequence[NewWord]) -> None:
    """Refuse words with which the owner's would take more bytes than they may."""
    sizes = {each.noun: each.size for each in before} | {each.noun: each.size for each in added}
    size, limit = sum(sizes.values()), app.settings.max_words_bytes
    if limit and size > limit:
        raise ParameterError(
            f"The words would take {readable_size(size)}, and {readable_size(limit)} can be kept.",
            advice="Delete some, or make them of fewer meshes.",
            limit=limit,
        )


def _named(files: Sequence[ReceivedFile]) -> dict[str, Path]:
    """Return the paths of files by names of their own."""
    named = dict[str, Path]()
    for number, file in enumerate(files, 1):
        name = file.filename or "mesh"
        named[f"{number}-{name}" if name in named else name] = file.path
    return named


def _file(word: Word, folder: Path) -> ReceivedFile:
    path = folder / f"kept-{word.noun}"
    path.write_bytes(word.data)
    return ReceivedFile(path, f"{word.noun}.word", len(word.data), hashlib.sha256(word.data).hexdigest())
