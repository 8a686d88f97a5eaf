"""Keep child processes that have imported what an answer takes, and remember what they read. Torch-free, numpy-free.

One child imports and does nothing else; whoever asks has a copy of it (`os.fork`), which no other owner's files reach.
A copy has no secrets in its environment, bounded memory, and less of the processor than whatever else wants it. It ends
with the socket by which it is asked. Needs a system with `fork`.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from meshdeform.assets.limits import bound_memory, error_to_json, start_child
from meshdeform.errors import DependencyError, MeshdeformError, UnavailableError

__all__ = ["Asked", "StoppedError", "WarmProcesses", "verdict_of"]

_MEMORY_BYTES = 16 * 2**30
"""Address space of a copy; torch alone maps several gigabytes of it."""
_NICE = 10
_GRACE_S = 3.0
"""How long a copy may take to notice that nobody waits for its answer, before it ends with all that it knows."""
_POLL_S = 0.1


class StoppedError(Exception):
    """Nobody waits for the answer any more."""


class Asked:
    """A question that may be taken back, from any thread."""

    def __init__(self) -> None:
        self._stopped = threading.Event()

    def stop(self) -> None:
        """Take the question back."""
        self._stopped.set()

    @property
    def stopped(self) -> bool:
        """Whether it was taken back."""
        return self._stopped.is_set()


@dataclass
class _Copy:
    """A process of one owner, as its parent knows it."""

    connection: socket.socket
    used_at: float = field(default_factory=time.monotonic)
    busy: bool = True
    received: bytes = b""
    owed: int = 0
    """Verdicts on questions that were taken back, which come before the next one."""
    owed_since: float = 0.0

    def ask(self, task: dict[str, Any], until: float, asked: Asked) -> dict[str, Any] | None:
        """Return its verdict; None: it has ended, or is still busy with a question that was taken back long ago.

        `TimeoutError`, `StoppedError`: it was told to stop, as time was up or nobody waits, and may be asked again.
        """
        self._tell(task)
        while (line := self._line()) is not None:
            if line and not self.owed:
                verdict: dict[str, Any] = json.loads(line)
                return verdict
            self.owed -= bool(line)
            now = time.monotonic()
            if asked.stopped or now > until:
                self._tell({})
                self.owed_since = self.owed_since if self.owed else now
                self.owed += 1
                raise StoppedError if asked.stopped else TimeoutError
            if self.owed and now > self.owed_since + _GRACE_S:
                return None
        return None

    def _tell(self, message: dict[str, Any]) -> None:
        self.connection.settimeout(_GRACE_S)
        try:
            self.connection.sendall(json.dumps(message).encode() + b"\n")
        except TimeoutError as error:  # not that of the question
            raise ConnectionError from error

    def _line(self) -> bytes | None:
        """Return the next verdict, if it comes within a moment, else nothing; None: it has ended."""
        if b"\n" not in self.received:
            self.connection.settimeout(_POLL_S)
            with contextlib.suppress(TimeoutError):
                chunk = self.connection.recv(2**16)
                if not chunk:
                    return None
                self.received += chunk
        if b"\n" not in self.received:
            return b""
        line, _, self.received = self.received.partition(b"\n")
        return line


class WarmProcesses:
    """Processes that answer by a module's function `answer`, at most one at a time for each owner. Thread-safe.

    Parameters
    ----------
    module : str
        Its full name; `answer` takes the task and a function that says whether to stop, which it asks now and then.
    most : int
        How many copies are kept; the one that was asked least recently goes.
    idle_s : float
        How long one is kept that nobody asks, and the process that imports after the last of them.
    """

    def __init__(self, module: str, *, most: int, idle_s: float) -> None:
        self.module, self._most, self._idle_s = module, most, idle_s
        self._lock = threading.Lock()
        self._first: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None
        self._copies: dict[str, _Copy] = {}
        self._used_at = time.monotonic()

    def prepare(self) -> None:
        """Start to import, and do not wait for it. Does nothing where processes cannot be copied."""
        if hasattr(os, "fork"):
            with self._lock, contextlib.suppress(UnavailableError):
                self._started()

    def ask(self, owner: str, task: dict[str, Any], timeout_s: float, asked: Asked) -> dict[str, Any] | None:
        """Return the verdict on a task; None: the process ended, as one does that takes too much memory.

        Raises
        ------
        TimeoutError, StoppedError
            It was not there in time, or before it was taken back.
        DependencyError
            This system cannot copy processes.
        UnavailableError
            No process can be started now.
        """
        until = time.monotonic() + timeout_s
        while True:
            copy = self._copy_of(owner)
            late, kept = copy.owed > 0, False
            try:
                verdict = copy.ask(task, until, asked)
                kept = verdict is not None
            except (StoppedError, TimeoutError):
                kept = True
                raise
            except OSError:
                verdict = None
            finally:
                self._leave(owner, copy, kept=kept)
            if verdict is not None or not late:  # else it ended with an earlier question
                return verdict

    def tidy(self) -> None:
        """End what nobody has asked for long."""
        with self._lock:
            before = time.monotonic() - self._idle_s
            for owner in [each for each, copy in self._copies.items() if not copy.busy and copy.used_at < before]:
                self._copies.pop(owner).connection.close()
            if not self._copies and self._used_at < before:
                self._end_first()

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            for copy in self._copies.values():
                copy.connection.close()
            self._copies.clear()
            self._end_first()

    def _copy_of(self, owner: str) -> _Copy:
        if not hasattr(os, "fork"):
            raise DependencyError("This server runs on a system that cannot copy processes.")
        with self._lock:
            copy = self._copies.pop(owner, None)
            if copy is not None and copy.busy:  # which its slot should have kept from happening
                self._copies[owner] = copy
                raise UnavailableError("Another question of yours is being answered.")
            if copy is None:
                self._make_room()
                copy = _Copy(self._connected())
            copy.busy = True
            self._copies[owner] = copy  # the last to go
            self._used_at = time.monotonic()
            return copy

    def _make_room(self) -> None:
        idle = [owner for owner, copy in self._copies.items() if not copy.busy]
        for owner in idle[: max(0, len(self._copies) + 1 - self._most)]:
            self._copies.pop(owner).connection.close()

    def _leave(self, owner: str, copy: _Copy, *, kept: bool) -> None:
        """Keep a copy for the next question, or end it."""
        with self._lock:
            copy.busy, copy.used_at = False, time.monotonic()
            if not kept:
                copy.connection.close()
                if self._copies.get(owner) is copy:
                    del self._copies[owner]

    def _connected(self) -> socket.socket:
        """Return the socket of a new copy."""
        ours, theirs = socket.socketpair()
        with theirs:
            try:
                socket.send_fds(self._started(), [b"."], [theirs.fileno()])
            except OSError:  # it has ended, and another one may live
                self._end_first()
                socket.send_fds(self._started(), [b"."], [theirs.fileno()])
        return ours

    def _started(self) -> socket.socket:
        if self._control is None or self._first is None or self._first.poll() is not None:
            self._end_first()
            ours, theirs = socket.socketpair()
            with theirs:
                arguments = [self.module, str(theirs.fileno())]
                self._first = start_child(__name__, arguments, passed=[theirs.fileno()])
            self._control, self._used_at = ours, time.monotonic()
        return self._control

    def _end_first(self) -> None:
        if self._control is not None:
            self._control.close()
        if self._first is not None:
            self._first.kill()  # which leaves copies alone
            if self._first.stdout is not None:
                self._first.stdout.close()
            self._first.wait()
        self._control = self._first = None


def main(arguments: list[str] | None = None) -> int:
    """Import a module, and copy this process for each socket that comes; in the child."""
    module, control_fd = sys.argv[1:] if arguments is None else arguments
    os.nice(_NICE)
    control = socket.socket(fileno=int(control_fd))
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nobody reads what a decoder may print
    try:
        answer = import_module(module).answer
    except ModuleNotFoundError as error:
        answer = _refusal(DependencyError(f"{error.name} is not installed."))
    gc.freeze()  # so that collections in copies leave the pages shared
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        data, fds, _, _ = socket.recv_fds(control, 1, 1)
        if not data:
            return 0
        if os.fork() == 0:
            control.close()
            _serve(socket.socket(fileno=fds[0]), answer)
            os._exit(0)
        os.close(fds[0])


def _refusal(error: MeshdeformError) -> Callable[..., Any]:
    def refuse(*_: object) -> None:
        raise error

    return refuse


@dataclass
class _Question:
    """A task as a copy has it."""

    task: dict[str, Any] = field(default_factory=dict)
    stop: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)

    def take_back(self) -> None:
        """Stop, or end this process with all that it knows."""
        self.stop.set()
        if not self.over.wait(_GRACE_S):
            os._exit(0)


def _serve(connection: socket.socket, answer: Callable[[dict[str, Any], Callable[[], bool]], Any]) -> None:
    """Answer the tasks of a socket until it is closed."""
    bound_memory(_MEMORY_BYTES)
    questions: queue.SimpleQueue[_Question] = queue.SimpleQueue()

    def receive() -> None:
        last = _Question()
        for line in connection.makefile("rb"):
            if task := json.loads(line):
                last = _Question(task)
                questions.put(last)
            else:
                threading.Thread(target=last.take_back, daemon=True).start()
        os._exit(0)

    threading.Thread(target=receive, daemon=True).start()
    while True:
        question = questions.get()
        stopped = question.stop.is_set
        verdict = {"stopped": True} if stopped() else verdict_of(answer, question.task, stopped)
        question.over.set()
        connection.sendall(json.dumps(verdict).encode() + b"\n")


def verdict_of(
    answer: Callable[[dict[str, Any], Callable[[], bool]], Any], task: dict[str, Any], stopped: Callable[[], bool]
) -> dict[str, Any]:
    """Return what a process says of a task: what `answer` found, its error, or that it was stopped."""
    try:
        return {"ok": True, "found": answer(task, stopped)}
    except StoppedError:
        return {"stopped": True}
    except MeshdeformError as error:
        return {"ok": False, "error": error_to_json(error)}
    except ModuleNotFoundError as error:
        return {"ok": False, "error": error_to_json(DependencyError(f"{error.name} is not installed."))}
