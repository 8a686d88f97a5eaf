"""Run child processes that do not outlive their parent, and wait for signals. Standard library only.

A child is started through a small launcher: on Linux it asks the kernel (``PR_SET_PDEATHSIG``) for a signal at its
parent's death, then becomes the program. This also covers a parent that was killed with SIGKILL and cannot clean up.
On other systems only the parent stops a child.

The kernel watches the *thread* that started the child: start children from the main thread.
"""

from __future__ import annotations

import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from types import TracebackType
from typing import IO, Self

# Not a preexec_fn, which is unsafe with threads: the launcher is a separate process until it becomes the program.
# 1 is PR_SET_PDEATHSIG. The check of the parent's id detects a parent that died before the call.
_LAUNCHER = """
import ctypes, os, signal, sys
parent, death_signal, program = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
ctypes.CDLL(None).prctl(1, death_signal)
if os.getppid() != parent:
    os._exit(1)
try:
    os.execvp(program[0], program)
except OSError as error:
    print(f"{program[0]}: {error.strerror}", file=sys.stderr)
    os._exit(127)
"""
FOREIGN_RECORD = 3
"""The exit code of a part that cannot use the record, whatever it waits for (`RecordVersionError`)."""


def python_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs one of our modules with this interpreter, ignoring the current folder's modules."""
    return [sys.executable, "-P", "-m", module, *arguments]


class Child:
    """A program in its own process group, so that Ctrl-C at the terminal reaches only its parent.

    `env`: environment variables to add or change; `stdin`: the content of its standard input; `pass_fds`: file
    descriptors that it inherits, under the same numbers. `on_line`: called with each line that it prints, from a
    thread. Without it the child shares our output.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        *,
        env: Mapping[str, str] | None = None,
        stdin: bytes = b"",
        pass_fds: Iterable[int] = (),
        on_line: Callable[[str], None] | None = None,
    ) -> None:
        self.name = name
        self._reader: threading.Thread | None = None
        pipe = subprocess.PIPE if on_line else None
        self._process = subprocess.Popen(
            _launcher_command(command),
            env={**os.environ, **(env or {})},
            stdin=subprocess.PIPE if stdin else subprocess.DEVNULL,
            stdout=pipe,
            stderr=subprocess.STDOUT if on_line else None,
            pass_fds=tuple(pass_fds),
            process_group=0,
        )
        self.started = time.monotonic()
        if self._process.stdin is not None:
            try:
                self._process.stdin.write(stdin)
                self._process.stdin.close()
            except BrokenPipeError:
                pass  # it died first; `exit_code` reports that
        if on_line and self._process.stdout is not None:
            arguments = (self._process.stdout, on_line)
            self._reader = threading.Thread(target=_read_lines, args=arguments, name=f"output of {name}", daemon=True)
            self._reader.start()

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """The exit code: None while it runs, or minus the number of the signal that ended it."""
        return self._process.poll()

    def ask_to_stop(self) -> None:
        """Send SIGTERM."""
        if self.exit_code is None:
            self._process.terminate()

    def kill(self) -> None:
        """Send SIGKILL to it and to its descendants, without waiting."""
        if self.exit_code is None:
            self._kill_group()

    def stop(self, grace_s: float) -> int:
        """Send SIGTERM, wait up to `grace_s` seconds, kill it with its descendants, and return its exit code."""
        self.ask_to_stop()
        try:
            self._process.wait(timeout=max(0.0, grace_s))
        except subprocess.TimeoutExpired:
            self._kill_group()
        code = self._process.wait()
        if self._reader is not None:
            # Wait for the last lines, but not for a grandchild that keeps the pipe open.
            self._reader.join(timeout=1.0)
        return code

    def _kill_group(self) -> None:
        try:
            os.killpg(self.pid, signal.SIGKILL)
        except ProcessLookupError:
            self._process.kill()


class Backoff:
    """Delays before restarting a program: they double each time, and reset once it has run for `healthy_s` seconds."""

    def __init__(self, first_s: float = 0.5, longest_s: float = 30.0, healthy_s: float = 30.0) -> None:
        self._first_s, self._longest_s, self._healthy_s = first_s, longest_s, healthy_s
        self._next_s = first_s

    def after(self, lived_s: float) -> float:
        """Return the seconds to wait before restarting a program that ran for `lived_s` seconds."""
        if lived_s >= self._healthy_s:
            self._next_s = self._first_s
        delay, self._next_s = self._next_s, min(2 * self._next_s, self._longest_s)
        return delay


class SupervisedChild:
    """A child that is restarted, with back-off, whenever it ends by itself.

    Exit codes in `at_once` request an immediate restart. `log` is called with one sentence each time the child ends,
    and `on_end` each time it ends by itself.
    """

    def __init__(
        self,
        start: Callable[[], Child],
        log: Callable[[str], None],
        on_end: Callable[[], None] | None = None,
        *,
        at_once: Collection[int] = (),
    ) -> None:
        self._start, self._log, self._on_end, self._backoff = start, log, on_end, Backoff()
        self._at_once = at_once
        self._due: float | None = None
        self.child = start()

    def supervise(self) -> None:
        """Restart the child if it has ended and its delay has passed; call this often."""
        if self._due is not None:
            if time.monotonic() >= self._due:
                self._due = None
                self.child = self._start()
        elif (code := self.child.exit_code) is not None:
            lived_s = time.monotonic() - self.child.started
            delay = 0.0 if code in self._at_once else self._backoff.after(lived_s)
            self._due = time.monotonic() + delay
            self._log(f"{self.child.name} {_describe_exit(code)}; starting it again in {delay:g} s")
            if self._on_end is not None:
                self._on_end()

    def restart(self) -> None:
        """Kill the child with its descendants, and let the next `supervise` start another one."""
        self.child.stop(0.0)
        if self._on_end is not None:
            self._on_end()
        self._due = time.monotonic()

    def ask_to_stop(self) -> None:
        """Send SIGTERM if it is running."""
        self.child.ask_to_stop()

    def stop(self, grace_s: float) -> None:
        """Stop the child without restarting it."""
        self.child.stop(grace_s)


class SignalInbox:
    """Collects signals until they are read. Use it in the main thread, as a context manager.

    A handler that sets a `threading.Event` can deadlock with the `wait` that it interrupts, and a handler that raises
    can raise anywhere. Here the interpreter only writes the signal's number to a socket.
    """

    def __init__(self, *signals: signal.Signals) -> None:
        self._signals = signals

    def __enter__(self) -> Self:
        self._read, self._write = socket.socketpair()
        self._read.setblocking(False)
        self._write.setblocking(False)
        self._previous_fd = signal.set_wakeup_fd(self._write.fileno(), warn_on_full_buffer=False)
        self._previous = {number: signal.signal(number, lambda *_: None) for number in self._signals}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._previous_fd)
        self._read.close()
        self._write.close()

    def wait(self, timeout_s: float) -> set[signal.Signals]:
        """Return the signals since the last call, after waiting up to `timeout_s` seconds for one."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._read, selectors.EVENT_READ)
            if not selector.select(timeout_s):
                return set()
        return {signal.Signals(number) for number in self._read.recv(4096)} & set(self._signals)


def _launcher_command(command: Sequence[str]) -> list[str]:
    if sys.platform != "linux":
        return list(command)
    return [sys.executable, "-I", "-S", "-c", _LAUNCHER, str(os.getpid()), str(int(signal.SIGTERM)), *command]


def _read_lines(stream: IO[bytes], on_line: Callable[[str], None]) -> None:
    with stream:
        for line in stream:
            on_line(line.decode(errors="replace").rstrip("\n"))


def _describe_exit(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"was ended by signal {-code}"
