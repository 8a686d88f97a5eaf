"""Words of owners' own: `meshdeform.words`. The content of each is a stored file, which a job that names it shares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import NotFoundError
from meshdeform.record.database import Database
from meshdeform.record.files import FileLedger
from meshdeform.record.rows import read
from meshdeform.record.schema import words


@dataclass(frozen=True)
class NewWord:
    """A word whose content, of `size` bytes, is stored and pinned as `key`.

    `told` is what `Word.told` says; `faces` the number of faces of each shape.
    """

    noun: str
    sha256: str
    key: str
    size: int
    told: dict[str, Any]
    faces: tuple[int, ...]


@dataclass(frozen=True)
class KeptWord:
    """A word of an owner, without its content; members as of `NewWord`."""

    owner_id: str
    noun: str
    sha256: str
    key: str
    size: int
    told: dict[str, Any]
    faces: tuple[int, ...]
    created_at: datetime


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

    def put(
        self,
        owner: str,
        added: Sequence[NewWord],
        *,
        check: Callable[[list[KeptWord]], None],
        also: Callable[[sa.Connection, list[KeptWord]], None],
    ) -> list[str]:
        """Keep words in the place of those of the same nouns, all or none; the pins of their contents are released.

        `check` gets the owner's words as they are before, `also` the new ones. Both are called in the same transaction,
        which their exceptions roll back. Returns the keys of the contents that were replaced, which may be needed
        elsewhere.
        """
        with self._database.write() as connection:
            self._database.serialise(connection, f"words {owner}")
            before = _all(connection, owner)
            check(before)
            nouns = {each.noun for each in added}
            connection.execute(sa.delete(words).where(words.c.owner_id == owner, words.c.noun.in_(nouns)))
            now = self._database.clock()
            rows = [{**asdict(each), "faces": list(each.faces), "owner_id": owner, "created_at": now} for each in added]
            connection.execute(sa.insert(words), rows)
            self._files.unpin({each.key for each in added}, connection)
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
