"""Record the states of a batch's rows, so that any run of it knows what was done."""

from __future__ import annotations

import fcntl
import json
import os
import threading
import uuid
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from meshdeform.cli.local import writing
from meshdeform.errors import ParameterError, UnavailableError

_NAME = "ledger.jsonl"
_VERSION = 1


class Ledger:
    """The states of a batch's rows: JSON lines in an append-only file, each on disk before anything relies on it.

    ::

        {"ledger": 1, "batch": ID, "created_at": ...}
        {"event": "submitted", "key": KEY, "name": NAME, "job_id": ..., "try": 0}
        {"event": "done", "key": KEY, "name": NAME, "seconds": ..., "files": {...}}
        {"event": "failed", "key": KEY, "name": NAME, "error": {...}}

    `last` has the newest line of each key, `tries` how many `failed` lines each has. An incomplete last line, left by a
    process that was killed, is removed. The file is locked: one process at a time. Thread-safe; a context manager.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / _NAME
        self.last: dict[str, dict[str, Any]] = {}
        self.tries: dict[str, int] = {}
        self.batch_id = ""
        self._lock = threading.Lock()
        with writing(self.path, "Choose another folder with -o."):
            folder.mkdir(parents=True, exist_ok=True)
            self._fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        try:
            self._lock_file()
            self._read()
        except BaseException:
            os.close(self._fd)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._fd)

    def append(self, event: str, key: str, name: str, **more: Any) -> None:
        """Add a line; it is on disk when this returns."""
        self._write({"event": event, "key": key, "name": name, "at": _now(), **more})

    def known_names(self) -> dict[str, str]:
        """Return the names of rows by key."""
        return {key: line["name"] for key, line in self.last.items()}

    def _lock_file(self) -> None:
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UnavailableError(
                f"Another `meshdeform batch` is using {self.path.parent}.",
                advice="Wait until it has ended, or choose another folder with -o.",
            ) from None

    def _read(self) -> None:
        data = self.path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            os.ftruncate(self._fd, len(whole))
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                document = json.loads(line)
                self._note(document)
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ParameterError(
                    f"{self.path}, line {number}, is not a line of a ledger.",
                    advice="Remove the line, or choose another folder with -o.",
                ) from error
        if not self.batch_id:
            self._write({"ledger": _VERSION, "batch": uuid.uuid4().hex, "created_at": _now()})
            _sync_folder(self.path.parent)

    def _note(self, document: dict[str, Any]) -> None:
        if not self.batch_id:
            if document["ledger"] != _VERSION:
                raise ValueError(document["ledger"])
            self.batch_id = str(document["batch"])
            return
        key = document["key"]
        self.last[key] = document
        if document["event"] == "failed":
            self.tries[key] = self.tries.get(key, 0) + 1

    def _write(self, document: dict[str, Any]) -> None:
        line = (json.dumps(document) + "\n").encode()
        with self._lock:
            with writing(self.path, "Free some space; the same command then resumes."):
                while line:
                    line = line[os.write(self._fd, line) :]
                os.fsync(self._fd)
            self._note(document)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
