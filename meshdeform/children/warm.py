"""Keep child processes that have imported what an answer takes, and remember what they read.

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
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from meshdeform.children.asking import ChildLostError, start_child
from meshdeform.children.protocol import Bounds, StoppedError, answer_of, found_in
from meshdeform.children.tasks import entry_point, loaded
from meshdeform.errors import DependencyError, MeshdeformError, UnavailableError

__all__ = ["Asked", "WarmProcesses"]

_BOUNDS = Bounds(memory_bytes=16 * 2**30, seconds=None, file_bytes=2**30)
"""Of a copy; torch alone maps several gigabytes of address space."""
_NICE = 10
_GRACE_S = 3.0
"""How long a copy may take to notice that nobody waits for its answer, before it ends with all that it knows."""
_POLL_S = 0.1


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
    """Answers to questions that were taken back, which come before the next one."""
    owed_since: float = 0.0

    def ask(self, given: Mapping[str, Any], until: float, asked: Asked) -> Any:
        """Return what it found, or raise what it raised.

        `TimeoutError`, `StoppedError`: it was told to stop, as time was up or nobody waits, and may be asked again.
        `ChildLostError`: it has ended, or is still busy with a question that was taken back long ago.
        """
        self._tell({"given": given})
        while (line := self._line()) is not None:
            if line and not self.owed:
                return found_in(json.loads(line))
            self.owed -= bool(line)
            now = time.monotonic()
            if asked.stopped or now > until:
                self._tell({"stop": True})
                self.owed_since = self.owed_since if self.owed else now
                self.owed += 1
                raise StoppedError if asked.stopped else TimeoutError
            if self.owed and now > self.owed_since + _GRACE_S:
                break
        raise ChildLostError

    def _tell(self, message: dict[str, Any]) -> None:
        self.connection.settimeout(_GRACE_S)
        try:
            self.connection.sendall(json.dumps(message).encode() + b"\n")
        except OSError as error:  # also a timeout, which is not that of the question
            raise ChildLostError from error

    def _line(self) -> bytes | None:
        """Return the next answer, if it comes within a moment, else nothing; None: it has ended."""
        if b"\n" not in self.received:
            self.connection.settimeout(_POLL_S)
            try:
                chunk = self.connection.recv(2**16)
            except TimeoutError:
                return b""
            except OSError:
                return None
            if not chunk:
                return None
            self.received += chunk
        if b"\n" not in self.received:
            return b""
        line, _, self.received = self.received.partition(b"\n")
        return line


class WarmProcesses:
    """Processes that carry out one task, at most one at a time for each owner. Thread-safe.

    Parameters
    ----------
    name : str
        The task's name.
    most : int
        How many copies are kept; the one that was asked least recently goes.
    idle_s : float
        How long one is kept that nobody asks, and the process that imports after the last of them.
    """

    def __init__(self, name: str, *, most: int, idle_s: float) -> None:
        self.name, self._most, self._idle_s = name, most, idle_s
        self._lock = threading.Lock()
        self._first: subprocess.Popen[bytes] | None = None
        self._channel: socket.socket | None = None
        self._copies: dict[str, _Copy] = {}
        self._used_at = time.monotonic()

    def prepare(self) -> None:
        """Start to import, and do not wait for it. Does nothing where processes cannot be copied."""
        if hasattr(os, "fork"):
            with self._lock, contextlib.suppress(UnavailableError):
                self._started()

    def ask(self, owner: str, given: Mapping[str, Any], timeout_s: float, asked: Asked) -> Any:
        """Return what was found of what is given (JSON).

        Raises
        ------
        TimeoutError, StoppedError
            It was not there in time, or before it was taken back.
        ChildLostError
            The process ended, as one does that takes too much memory.
        DependencyError
            This system cannot copy processes.
        UnavailableError
            No process can be started now.
        MeshdeformError
            What the task raised.
        """
        until = time.monotonic() + timeout_s
        while True:
            copy = self._copy_of(owner)
            late, kept = copy.owed > 0, False
            try:
                found = copy.ask(given, until, asked)
            except (StoppedError, TimeoutError, MeshdeformError):
                kept = True
                raise
            except ChildLostError:
                if not late:  # else it ended with an earlier question
                    raise
            else:
                kept = True
                return found
            finally:
                self._leave(owner, copy, kept=kept)

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
        if self._channel is None or self._first is None or self._first.poll() is not None:
            self._end_first()
            ours, theirs = socket.socketpair()
            with theirs:
                given = {"task": entry_point(self.name), "channel": theirs.fileno()}
                self._first = start_child("copies", given, _BOUNDS, passed=[theirs.fileno()])
            self._channel, self._used_at = ours, time.monotonic()
        return self._channel

    def _end_first(self) -> None:
        if self._channel is not None:
            self._channel.close()
        if self._first is not None:
            self._first.kill()  # which leaves copies alone
            if self._first.stdout is not None:
                self._first.stdout.close()
            self._first.wait()
        self._channel = self._first = None


def make_copies(given: dict[str, Any]) -> None:
    """Import a task, and copy this process for each socket that comes; in the child."""
    os.nice(_NICE)
    channel = socket.socket(fileno=given["channel"])
    try:
        answer = loaded(given["task"])
    except ModuleNotFoundError as error:
        answer = _refusal(DependencyError(f"{error.name} is not installed."))
    gc.freeze()  # so that collections in copies leave the pages shared
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        data, fds, _, _ = socket.recv_fds(channel, 1, 1)
        if not data:
            return
        if os.fork() == 0:
            channel.close()
            try:
                _serve(socket.socket(fileno=fds[0]), answer)
            finally:
                os._exit(0)
        os.close(fds[0])


def _refusal(error: MeshdeformError) -> Callable[..., Any]:
    def refuse(*_: object) -> None:
        raise error

    return refuse


@dataclass
class _Question:
    """What is given to a copy."""

    given: dict[str, Any] = field(default_factory=dict)
    stop: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)

    def take_back(self) -> None:
        """Stop, or end this process with all that it knows."""
        self.stop.set()
        if not self.over.wait(_GRACE_S):
            os._exit(0)

    def answer(self, find: Callable[[dict[str, Any], Callable[[], bool]], Any]) -> Any:
        """Return what is found, unless it was taken back before."""
        if self.stop.is_set():
            raise StoppedError
        return find(self.given, self.stop.is_set)


def _serve(connection: socket.socket, find: Callable[[dict[str, Any], Callable[[], bool]], Any]) -> None:
    """Answer the questions of a socket until it is closed."""
    questions: queue.SimpleQueue[_Question] = queue.SimpleQueue()

    def receive() -> None:
        last = _Question()
        for line in connection.makefile("rb"):
            told = json.loads(line)
            if "given" in told:
                last = _Question(told["given"])
                questions.put(last)
            else:
                threading.Thread(target=last.take_back, daemon=True).start()
        os._exit(0)

    threading.Thread(target=receive, daemon=True).start()
    while True:
        question = questions.get()
        answer = answer_of(partial(question.answer, find))
        question.over.set()
        connection.sendall(json.dumps(answer).encode() + b"\n")
