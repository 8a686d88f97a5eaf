"""Let requests for jobs know the words of their owner: those that one names are pinned, and go with the job."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from meshdeform.record.models import Job
from meshdeform.record.words import KeptWord
from meshdeform.requests.document import JobRequest
from meshdeform.requests.parameters import WORDS_FIELD, ExemplarParams
from meshdeform.runs.word_pins import pinned, pins_of, words_named, words_of
from meshdeform.words import ShapeSource, Word, read_words
from meshdeform.words.limits import MAX_WORDS_BYTES
from service.http.forms import ReceivedFile
from service.state import AppState

R = TypeVar("R", bound=JobRequest)


def as_word(kept: KeptWord, data: bytes = b"") -> Word:
    """Return a word of the record with its content. Without that, it has names and parts, and no shapes."""
    told = kept.told
    sources = tuple(ShapeSource(**each) for each in told["shapes"])
    return Word(kept.noun, tuple(told["synonyms"]), told["like"], tuple(told["parts"]), sources, kept.faces, data)


def named_words(app: AppState, owner_id: str, *, sent: Sequence[Word] = ()) -> list[Word]:
    """Return all words that a request may name: those that come with it, then the owner's, which have no content."""
    return [*sent, *(as_word(kept) for kept in _others(app, owner_id, sent))]


def pin_words(
    app: AppState, owner_id: str, request: R, folder: Path, *, sent: Sequence[Word] = ()
) -> tuple[R, ReceivedFile | None, list[Word]]:
    """Return a request that pins the words it names, the file with their content, if there are any, and these words.

    `sent`: words that come with the request, or with the job that it continues, before the owner's of the same nouns.
    """
    if not isinstance(getattr(request.params, "guidance", None), ExemplarParams):  # nothing else knows words
        return request, None, []
    others = _others(app, owner_id, sent)
    named = words_named(request, [*sent, *(as_word(kept) for kept in others)])
    nouns = {*pins_of(request), *(word.noun for word in named)}
    own = [as_word(kept, app.store.get(kept.key, sha256=kept.sha256)) for kept in others if kept.noun in nouns]
    request, data = pinned(request, [*sent, *own])
    if data is None:
        return request, None, []
    path = folder / f"{WORDS_FIELD}-pinned"
    path.write_bytes(data)
    file = ReceivedFile(path, "words.word", len(data), hashlib.sha256(data).hexdigest())
    return request, file, words_of(pins_of(request), data)


def with_others(app: AppState, owner_id: str, words: Sequence[Word]) -> list[Word]:
    """Return words with the owner's other ones: the newest, up to `MAX_WORDS_BYTES` of content."""
    known, left = list(words), MAX_WORDS_BYTES
    for kept in sorted(_others(app, owner_id, words), key=lambda each: each.created_at, reverse=True):
        left -= kept.size
        if left < 0:
            break
        known.append(as_word(kept, app.store.get(kept.key, sha256=kept.sha256)))
    return known


def _others(app: AppState, owner_id: str, sent: Sequence[Word]) -> list[KeptWord]:
    """Return the owner's words but those whose nouns were sent."""
    taken = {word.noun for word in sent}
    return [kept for kept in app.record.words.all(owner_id) if kept.noun not in taken]


def words_of_job(app: AppState, job: Job) -> list[Word]:
    """Return the words that a job has, as they were when it was accepted."""
    file = job.files.get(WORDS_FIELD)
    return [] if file is None else read_words(app.store.get(file.key, sha256=file.sha256))
