"""Ask a child process about an asset and what it was read as; the reading goes there and comes back. Torch-free."""

from __future__ import annotations

import hashlib
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.assets.limits import Limits
from meshdeform.requests.choices import BackdropMode
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.kept_readings import Readings, Unkept, key_of
from meshdeform.runs.questions import Question
from meshdeform.words import Word, in_use, words_in_use
from meshdeform.words.file import SUFFIX

if TYPE_CHECKING:
    from meshdeform.assets import Asset
    from meshdeform.plain.body import Body

__all__ = ["ask_about", "is_read", "loaded", "samples_of", "with_words"]

_TIMEOUT_S = 120.0


def ask_about(
    question: Question,
    asset: Path,
    filename: str,
    params: ResolvedParams,
    limits: Limits,
    readings: Readings | None,
    **more: Any,
) -> dict[str, Any]:
    """Let the child answer, with the reading that is kept; keep the one that it made.

    `filename`: the asset's name, of which the extension counts; `more`: further members of the child's task.
    """
    readings, suffix = readings or Unkept(), Path(filename).suffix[:16]
    digest = _digest(asset)
    key = key_of(digest, suffix, params)
    beside, kept = asset.absolute().with_name(f"{key}.reading"), readings.get(key)
    if kept is None:
        beside.unlink(missing_ok=True)  # of an earlier question about the same file
    else:
        beside.write_bytes(kept)
    task = {
        "asset": str(asset.absolute()),
        "filename": f"asset{suffix}",
        "params": params.model_dump(mode="json"),
        "limits": asdict(limits),
        "digest": digest,
        "reading": str(beside),
        "samples": None if readings.samples is None else str(readings.samples.absolute()),
        "words": [],
        **more,
    }
    for word in words_in_use():  # a file each: all that an owner has may be more than one file can hold
        content = asset.absolute().with_name(f"{word.sha256}{SUFFIX}")
        content.write_bytes(word.data)
        task["words"].append(str(content))
    answer: dict[str, Any] = question.ask(task, asset.absolute().parent, _TIMEOUT_S)
    made = beside.read_bytes() if beside.is_file() else kept
    if made is not None and made != kept:
        readings.put(key, made)
    return answer


def is_read(asset: Path, filename: str, params: ResolvedParams, readings: Readings) -> bool:
    """Return whether a reading of an asset is kept."""
    return readings.get(key_of(_digest(asset), Path(filename).suffix[:16], params)) is not None


def with_words(task: dict[str, Any]) -> AbstractContextManager[object]:
    """Let a child know the words that its parent knows, within the block."""
    return in_use(Word.read(Path(path).read_bytes()) for path in task["words"])


def loaded(task: dict[str, Any]) -> tuple[Asset, Body, ResolvedParams]:
    """Return the asset of a child's task, its body, which can be read, and the parameters."""
    from meshdeform.assets import load_asset
    from meshdeform.plain.body import loose_body
    from meshdeform.requests.selection import find_excluded
    from meshdeform.runs.reading import ReadingSource, corrected

    params = ResolvedParams.model_validate(task["params"])
    asset = load_asset(Path(task["asset"]).read_bytes(), task["filename"], Limits(**task["limits"]))
    asset = asset.without(find_excluded(params.exclude, asset.pieces().nodes))
    kept = _File(Path(task["reading"]), samples_of(task))
    source = ReadingSource(task["digest"], task["filename"], kept=kept)
    body = loose_body(asset, backdrop=params.backdrop is BackdropMode.DEFORM)
    return asset, corrected(body, asset, params, source), params


def samples_of(task: dict[str, Any]) -> Path | None:
    """Return the folder for samples of nouns, if the machine has one."""
    return None if task["samples"] is None else Path(task["samples"])


def _digest(asset: Path) -> str:
    with asset.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class _File:
    """A reading that the parent of this process handed to it, and takes back."""

    path: Path
    samples: Path | None

    def get(self, _key: str) -> bytes | None:
        """Return the reading that the parent handed over; None if it handed over none."""
        return self.path.read_bytes() if self.path.is_file() else None

    def put(self, _key: str, data: bytes) -> None:
        """Write a reading for the parent to take back."""
        self.path.write_bytes(data)
