"""Make or draw a word in a child process, for a process without torch. Torch-free, numpy-free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshdeform.assets.limits import Limits
from meshdeform.runs.questions import Question
from meshdeform.words import Word, WordOffer

__all__ = ["drawn_word", "made_word"]

_TIMEOUT_S, _PICTURE_TIMEOUT_S = 600.0, 60.0
_QUESTION = Question(
    "word",
    cannot="The word cannot be made on this server.",
    lacks="Words are made with the extra `deform`, which the API of this server lacks",
    instead="Make it elsewhere (meshdeform words add), and send the file that `meshdeform words export` writes.",
)
_PICTURE = Question(
    "word_picture",
    cannot="The word cannot be drawn on this server.",
    lacks="Words are drawn with the extra `deform`, which the API of this server lacks",
    instead="Export it, and draw it elsewhere: meshdeform words show NOUN --picture FILE.png.",
)


def made_word(
    offer: WordOffer, files: Mapping[str, Path], folder: Path, limits: Limits, samples: Path | None = None
) -> Word:
    """Return the word of meshes, as `making.make_word` makes it.

    `files`: meshes by the names that the user gave them. `folder`: for files of the child. `samples`: folder
    for samples of nouns, if the machine has one. Raises what `make_word` does, and UnavailableError or
    DependencyError: it cannot be made here.
    """
    folder = folder.absolute()
    task = {
        "offer": asdict(offer),
        "files": {name: str(path.absolute()) for name, path in files.items()},
        "limits": asdict(limits),
        "samples": None if samples is None else str(samples.absolute()),
        "result": str(folder / "made.word"),
    }
    _QUESTION.ask(task, folder, _TIMEOUT_S)
    return Word.read((folder / "made.word").read_bytes())


def drawn_word(data: bytes, folder: Path) -> bytes:
    """Return a PNG of the shapes of a word's file; `folder`: for files of the child.

    Raises UnavailableError, DependencyError: it cannot be drawn here.
    """
    folder = folder.absolute()
    (folder / "word").write_bytes(data)
    task = {"word": str(folder / "word"), "result": str(folder / "word.png")}
    _PICTURE.ask(task, folder, _PICTURE_TIMEOUT_S)
    return (folder / "word.png").read_bytes()


def draw_given(task: dict[str, Any]) -> None:
    """Draw a word, and write the picture where the task says, in the child."""
    from meshdeform.kinds.words.picture import word_png

    Path(task["result"]).write_bytes(word_png(Word.read(Path(task["word"]).read_bytes())))


def make_given(task: dict[str, Any]) -> None:
    """Make a word, and write it where the task says, in the child."""
    from meshdeform.kinds.words.making import make_word
    from meshdeform.runs.kept_readings import Unkept

    readings = Unkept(None if task["samples"] is None else Path(task["samples"]))
    offer = WordOffer(**task["offer"])
    files = {name: Path(path).read_bytes() for name, path in task["files"].items()}
    word = make_word(offer, files, Limits(**task["limits"]), readings)
    Path(task["result"]).write_bytes(word.data)
