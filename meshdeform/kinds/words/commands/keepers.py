"""Keep words for `meshdeform words`: in a folder of this machine, or at a service. Both say the same of a word."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.cli.environment import load_settings, require

if TYPE_CHECKING:
    from meshdeform.client import Client
    from meshdeform.words import Word


class FolderWords:
    """Words in the folder of this machine."""

    def __init__(self) -> None:
        from meshdeform.words import WordFolder

        self._settings = load_settings()
        self._store = WordFolder(self._settings.words_folder)

    def add(self, said: Mapping[str, Any], paths: Mapping[str, Path], *, replace: bool) -> dict[str, Any]:
        """Make a word of meshes by their names, keep it, and return what it is; `said` is as a service takes it."""
        require("fast_simplification", "deform")
        from meshdeform.kinds.words.making import make_word
        from meshdeform.runs.kept_readings import FolderReadings
        from meshdeform.words import WordOffer, check_names

        synonyms = tuple(said["synonyms"])
        check_names(said["noun"], synonyms, self._store.words(), replace=replace)
        offer = WordOffer(said["noun"], synonyms, said["like"], said["front"], said["fronts"], said["licence"])
        limits, files = _read(paths)
        word = make_word(offer, files, limits, FolderReadings(self._settings.cache_folder))
        self._store.add([word], replace=replace)
        return _document(word)

    def take(self, data: bytes, *, replace: bool) -> list[dict[str, Any]]:
        """Keep the words of a file, all or none."""
        from meshdeform.words import read_words

        found = [word.checked() for word in read_words(data)]
        self._store.add(found, replace=replace)
        return [_document(word) for word in found]

    def all(self) -> list[dict[str, Any]]:
        """Return what all words are."""
        return [_document(word) for word in self._store.words()]

    def one(self, noun: str) -> dict[str, Any]:
        """Return what a word is."""
        return _document(self._store.word(noun))

    def content(self, noun: str) -> bytes:
        """Return a word's file."""
        return self._store.word(noun).data

    def picture(self, noun: str) -> bytes:
        """Return a PNG of a word's meshes."""
        require("scipy", "deform")
        from meshdeform.kinds.words.picture import word_png

        return word_png(self._store.word(noun))

    def remove(self, nouns: Sequence[str]) -> None:
        """Remove words, all or none."""
        self._store.remove(nouns)


class ServiceWords:
    """Words at a service; the methods are those of `FolderWords`."""

    def __init__(self, client: Client) -> None:
        self._client = client

    def add(self, said: Mapping[str, Any], paths: Mapping[str, Path], *, replace: bool) -> dict[str, Any]:
        """Make a word of meshes."""
        meshes = []
        for name, data in _read(paths)[1].items():
            stream = io.BytesIO(data)
            stream.name = name
            meshes.append(stream)
        return self.one(self._client.add_word(**said, meshes=meshes, replace=replace).noun)

    def take(self, data: bytes, *, replace: bool) -> list[dict[str, Any]]:
        """Keep the words of a file, all or none."""
        return [word.as_json() for word in self._client.import_words(data, replace=replace)]

    def all(self) -> list[dict[str, Any]]:
        """Return what all words are."""
        return [word.as_json() for word in self._client.words()]

    def one(self, noun: str) -> dict[str, Any]:
        """Return what a word is."""
        return self._client.word(noun).as_json()

    def content(self, noun: str) -> bytes:
        """Return a word's file."""
        return self._client.export_word(noun)

    def picture(self, noun: str) -> bytes:
        """Return a PNG of a word's meshes."""
        return self._client.draw_word(noun)

    def remove(self, nouns: Sequence[str]) -> None:
        """Remove words, up to one that there is not."""
        for noun in nouns:
            self._client.delete_word(noun)


def _read(paths: Mapping[str, Path]) -> tuple[Any, dict[str, bytes]]:
    """Return the limits of files, and the meshes at these paths with the files that they name."""
    from meshdeform.assets import Limits
    from meshdeform.assets.bundle import read_with_files

    limits = Limits.from_settings(load_settings())
    return limits, {name: read_with_files(path, limits) for name, path in paths.items()}


def _document(word: Word) -> dict[str, Any]:
    """Return what a word is, as a service says it."""
    return {
        **{name: value for name, value in word.told.items() if name != "shapes"},
        "meshes": len(word.faces),
        "faces": sum(word.faces),
        "size": len(word.data),
        "sha256": word.sha256,
        "sources": [{**vars(source), "faces": faces} for source, faces in zip(word.sources, word.faces, strict=True)],
    }
