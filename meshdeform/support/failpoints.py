"""Define named points where tests can make a process die, stop, fail or wait.

A call only checks an empty dict unless ``MESHDEFORM_FAILPOINTS`` is set. The variable is read once, at import, and is
not a setting, since no deployment needs it. It lists points and their actions::

    NAME=ACTION[@N][:FILE][;ONCE],NAME=...

    kill          SIGKILL to this process
    stop          SIGSTOP to this process
    raise         RuntimeError
    pause:FILE    create FILE.reached, then wait until there is FILE.go
    @N            only the N-th time that this process reaches the point
    ;ONCE         only if the file ONCE can be created, so that a restarted process does not act again
"""

from __future__ import annotations

import os
import re
import signal
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

FAILPOINTS: tuple[str, ...] = (
    "api.received",
    "api.stored",
    "api.recorded",
    "api.enqueued",
    "worker.told",
    "worker.claimed",
    "worker.started",
    "worker.step",
    "worker.checkpoint.stored",
    "worker.checkpoint.recorded",
    "worker.finished",
    "worker.result.stored",
    "worker.results.stored",
    "worker.ended",
    "supervisor.reclaimed",
    "reconciler.reclaimed",
    "reconciler.told",
)
"""Every name, in the order in which a job reaches them."""

_VARIABLE = "MESHDEFORM_FAILPOINTS"
_POLL_S = 0.01
_POINT = re.compile(
    r"(?P<name>[a-z.]+)=(?P<action>kill|stop|raise|pause)(@(?P<hit>[1-9]\d*))?(:(?P<file>[^;]+))?(;(?P<once>.+))?"
)
_hits: Counter[str] = Counter()
_lock = threading.Lock()


@dataclass(frozen=True)
class _Point:
    action: str
    hit: int | None
    file: str | None
    once: str | None


def _parse(text: str) -> dict[str, _Point]:
    points = {}
    for entry in filter(None, text.split(",")):
        match = _POINT.fullmatch(entry)
        if match is None or match["name"] not in FAILPOINTS or (match["action"] == "pause") != bool(match["file"]):
            raise ValueError(f"{_VARIABLE}: {entry!r} is not a failpoint")
        hit = int(match["hit"]) if match["hit"] else None
        points[match["name"]] = _Point(match["action"], hit, match["file"], match["once"])
    return points


_points = _parse(os.environ.get(_VARIABLE, ""))


def failpoint(name: str) -> None:
    """Perform the action that the environment sets for this point, if any; `RuntimeError`: the action is `raise`."""
    if _points:
        _reach(name)


def _reach(name: str) -> None:
    point = _points.get(name)
    if point is None:
        return
    with _lock:
        _hits[name] += 1
        hit = _hits[name]
    if (point.hit is None or point.hit == hit) and (point.once is None or _first(Path(point.once))):
        _act(name, point)


def _first(path: Path) -> bool:
    try:
        path.open("x").close()
    except FileExistsError:
        return False
    return True


def _act(name: str, point: _Point) -> None:
    if point.action == "raise":
        raise RuntimeError(f"failpoint {name}")
    if point.action == "pause":
        Path(f"{point.file}.reached").touch()
        while not Path(f"{point.file}.go").exists():
            time.sleep(_POLL_S)
        return
    os.kill(os.getpid(), signal.SIGKILL if point.action == "kill" else signal.SIGSTOP)
