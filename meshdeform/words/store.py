"""Keep the words of a user in a folder, one file each.

Files are written aside and renamed, all or none; what another process does at the same time, the last one wins.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from pathlib import Path

from meshdeform.errors import AssetError, NotFoundError, ParameterError
from meshdeform.support.files import write_files
from meshdeform.words.file import NAME, SUFFIX, Word
from meshdeform.words.limits import MAX_WORDS
from meshdeform.words.names import check_names

__all__ = ["WordFolder"]

_log = logging.getLogger(__name__)


class WordFolder:
    """The words in a folder, which is made when there is something to keep."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def words(self) -> list[Word]:
        """Return all words, by the alphabet; files that are no words are told in the log and left out."""
        found = []
        for path in sorted(self.folder.glob(f"*{SUFFIX}")):
            try:
                word = Word.read(path.read_bytes())
            except (AssetError, OSError) as error:
                _log.warning("%s is left out: %s", path, error)
                continue
            if word.noun == path.stem:
                found.append(word)
            else:
                _log.warning("%s is left out: it holds the word %s", path, word.noun)
        return found

    def word(self, noun: str) -> Word:
        """Return a word by its noun.

        Raises
        ------
        NotFoundError
            There is none.
        AssetError
            Its file is damaged.
        """
        try:
            return Word.read(self._path(noun).read_bytes()).checked()
        except FileNotFoundError:
            raise self._missing(noun) from None

    def add(self, words: Sequence[Word], *, replace: bool = False) -> None:
        """Keep words, all or none; `replace` as in `check_names`.

        Raises
        ------
        ParameterError
            The names of one are not free, or there would be more than `MAX_WORDS`.
        """
        kept = {word.noun: word for word in self.words()}
        for word in words:
            check_names(word.noun, word.synonyms, kept.values(), replace=replace)
            kept[word.noun] = word
        if len(kept) > MAX_WORDS:
            raise ParameterError(
                f"There would be {len(kept)} words, and {MAX_WORDS} can be kept.", advice="Remove some."
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        write_files({self._path(word.noun): word.data for word in words})

    def remove(self, nouns: Iterable[str]) -> None:
        """Remove words; jobs that have them keep them.

        Raises NotFoundError: there is none of a noun, and nothing was removed.
        """
        paths = [self._path(noun) for noun in nouns]
        for path in paths:
            if not path.is_file():
                raise self._missing(path.stem)
        for path in paths:
            path.unlink(missing_ok=True)

    def _missing(self, noun: str) -> NotFoundError:
        known = ", ".join(path.stem for path in sorted(self.folder.glob(f"*{SUFFIX}"))[:20])
        return NotFoundError(f"You have no word {noun!r}.", advice=f"Yours: {known or 'none'}.")

    def _path(self, noun: str) -> Path:
        if not NAME.fullmatch(noun):
            raise self._missing(noun[:80])
        return self.folder / f"{noun}{SUFFIX}"
