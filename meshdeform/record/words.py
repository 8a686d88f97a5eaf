"""Words of owners' own: `meshdeform.words`. The content of each is a stored file, which a job that names it shares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import NotFoundError, ParameterError, readable_size
from meshdeform.record.database import Database
from meshdeform.record.files import FileLedger
from meshdeform.record.rows import read
from meshdeform.record.schema import words
from meshdeform.words import Source, Word, check_names


@dataclass(frozen=True)
class KeptWord:
    """A word of an owner, without its content, which is the stored file `key` of `size` bytes.

    `told` is what `Word.told` says; `faces` the number of faces of each shape.
    """

    owner_id: str
    noun: str
    sha256: str
    key: str
    size: int
    told: dict[str, Any]
    faces: tuple[int, ...]
    created_at: datetime

    def word(self, data: bytes = b"") -> Word:
        """Return the word with this content. Without any, it has names and parts, and no shapes."""
        told, sources = self.told, tuple(Source(**each) for each in self.told["shapes"])
        parts, synonyms = tuple(told["parts"]), tuple(told["synonyms"])
        return Word(self.noun, synonyms, told["like"], parts, sources, self.faces, data)


class WordLedger:
    """Every word. Each look-up names the owner, so that those of other owners are not found (`NotFoundError`)."""

    def __init__(self, database: Database, files: FileLedger) -> None:
        self._database, self._files = database, files

    def all(self, owner: str) -> list[KeptWord]:
        """Return the owner's words, by the alphabet."""
        with self._database.read() as connection:
            return _all(connection, owner)

    def get(self, noun: str, owner: str) -> KeptWord:
        """Return a word."""
        with self._database.read() as connection:
            row = connection.execute(sa.select(words).where(_is(noun, owner))).one_or_none()
        if row is None:
            raise _missing(noun)
        return _kept(row)

    def check(self, owner: str, added: Sequence[tuple[str, Sequence[str]]], *, replace: bool, max_words: int) -> None:
        """Refuse nouns with synonyms of which `put` would refuse a word, as far as that is known without its shapes."""
        _check(self.all(owner), added, replace, max_words)

    def put(
        self,
        owner: str,
        added: Sequence[tuple[Word, str]],
        *,
        replace: bool,
        max_words: int,
        max_bytes: int,
        also: Callable[[sa.Connection, list[KeptWord]], None],
    ) -> list[str]:
        """Keep words, all or none; each with the key of its stored and pinned content, whose pin is released.

        `replace` as in `check_names`; `max_words` and `max_bytes` of all words of the owner, 0 bytes: unlimited. `also`
        is called in the same transaction, which its exceptions roll back.

        Returns the keys of the contents that were replaced, which may be needed elsewhere. `ParameterError`: names are
        not free, or there are too many words or bytes.
        """
        with self._database.write() as connection:
            if not self._database.is_sqlite:
                # Concurrent transactions would each find room, and the names free.
                connection.execute(sa.select(sa.func.pg_advisory_xact_lock(sa.func.hashtext(f"words {owner}"))))
            before = _all(connection, owner)
            _check(before, [(word.noun, word.synonyms) for word, _ in added], replace, max_words)
            nouns = {word.noun for word, _ in added}
            stays = sum(each.size for each in before if each.noun not in nouns)
            _check_bytes(stays + sum(len(word.data) for word, _ in added), max_bytes)
            connection.execute(sa.delete(words).where(words.c.owner_id == owner, words.c.noun.in_(nouns)))
            rows = [self._row(owner, word, key) for word, key in added]
            connection.execute(sa.insert(words), rows)
            self._files.unpin({key for _, key in added}, connection)
            also(connection, [each for each in _all(connection, owner) if each.noun in nouns])
        return sorted({each.key for each in before if each.noun in nouns})

    def delete(self, noun: str, owner: str) -> str:
        """Delete a word, and return the key of its content, which may be needed elsewhere."""
        deleted = sa.delete(words).where(_is(noun, owner)).returning(words.c.key)
        with self._database.write() as connection:
            key: str | None = connection.execute(deleted).scalar_one_or_none()
        if key is None:
            raise _missing(noun)
        return key

    def _row(self, owner: str, word: Word, key: str) -> dict[str, Any]:
        return {
            "owner_id": owner,
            "noun": word.noun,
            "sha256": word.sha256,
            "key": key,
            "size": len(word.data),
            "told": word.told,
            "faces": list(word.faces),
            "created_at": self._database.clock(),
        }


def _check(before: Sequence[KeptWord], added: Sequence[tuple[str, Sequence[str]]], replace: bool, limit: int) -> None:
    """Refuse words whose names are not free, or one more than there may be."""
    kept = {each.noun: each.word() for each in before}
    for noun, synonyms in added:
        check_names(noun, synonyms, kept.values(), replace=replace)
        kept[noun] = Word(noun, tuple(synonyms), "", (), (), (), b"")
    if len(kept) > limit:
        raise ParameterError(
            f"There would be {len(kept)} words, and {limit} can be kept.", advice="Delete some.", limit=limit
        )


def _check_bytes(size: int, limit: int) -> None:
    if limit and size > limit:
        raise ParameterError(
            f"The words would take {readable_size(size)}, and {readable_size(limit)} can be kept.",
            advice="Delete some, or make them of fewer meshes.",
            limit=limit,
        )


def _all(connection: sa.Connection, owner: str) -> list[KeptWord]:
    query = sa.select(words).where(words.c.owner_id == owner)
    # Sorted here: databases have different ideas of the alphabet.
    return sorted((_kept(row) for row in connection.execute(query)), key=lambda each: each.noun)


def _kept(row: sa.Row[Any]) -> KeptWord:
    return read(KeptWord, row, faces=tuple(row.faces))


def _is(noun: str, owner: str) -> sa.ColumnElement[bool]:
    return sa.and_(words.c.owner_id == owner, words.c.noun == noun)


def _missing(noun: str) -> NotFoundError:
    return NotFoundError(f"You have no word {noun!r}.", advice="GET /v1/words lists yours.")
