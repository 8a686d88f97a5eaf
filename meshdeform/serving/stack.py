"""Run `meshdeform serve`: start, supervise and stop Redis, API and worker as child processes.

Each part is configured through its environment, so that the same programs also run without this module. The listening
socket is created here and passed to the API: a port in use is an error before anything starts, and requests wait
instead of failing while the API restarts.
"""

from __future__ import annotations

import fcntl
import os
import signal
import socket
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from meshdeform.errors import RecordVersionError, UnavailableError
from meshdeform.serving import DEFAULT_HOST, DEFAULT_PORT
from meshdeform.serving.processes import FOREIGN_RECORD, Child, SignalInbox, SupervisedChild, python_command
from meshdeform.serving.redis_server import RedisServer
from meshdeform.settings import Settings
from meshdeform.support.telemetry import PART, json_line

_NAME = "serve.lock"
STOP_GRACE_S = 40.0
"""Seconds for the worker to write a checkpoint. Its supervisor allows less, so that this limit never cuts it short."""
_TELLS = "worker"
"""The part that has an exit code for a record that it cannot use; the API's server takes the same for any failure."""
_SUPERVISE_EVERY_S = 0.25
_BACKLOG = 2048


class DirectoryLock:
    """An exclusive lock on a directory, held by this process and by every child that inherits `fd`.

    A `serve` that starts right after another was killed therefore waits until the last child has exited, for
    `patience_s` seconds, instead of sharing the record, the port and the queue with it.
    """

    def __init__(self, directory: Path, *, patience_s: float = 40.0) -> None:
        path = directory / _NAME
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self.fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise UnavailableError(
                f"The data directory {directory} cannot be written: {error.strerror}.",
                advice="Make it writable, or choose another with --data-dir.",
            ) from error
        deadline = time.monotonic() + patience_s
        while not self._try():
            holder = self._holder()
            if _alive(holder) or time.monotonic() > deadline:
                os.close(self.fd)
                raise UnavailableError(
                    f"Another `meshdeform serve` (process {holder}) runs on {directory}.",
                    advice="Stop it first, or choose another directory with --data-dir.",
                )
            time.sleep(0.05)
        os.ftruncate(self.fd, 0)
        os.pwrite(self.fd, f"{os.getpid()}\n".encode(), 0)

    def close(self) -> None:
        """Release this process's hold on the lock; children that still run keep theirs."""
        os.close(self.fd)

    def _try(self) -> bool:
        try:
            fcntl.flock(self.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _holder(self) -> int:
        """Return the id of the last process to take the lock, or 0."""
        text = os.pread(self.fd, 32, 0).strip()
        return int(text) if text.isdigit() else 0


def _alive(pid: int) -> bool:
    if pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def listen(host: str, port: int) -> socket.socket:
    """Return a listening TCP socket; port 0 selects a free port. `UnavailableError`: the address cannot be used."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, kind, protocol)
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(address)
            listening.listen(_BACKLOG)
        except BaseException:
            listening.close()
            raise
    except OSError as error:
        raise UnavailableError(
            f"Cannot listen on {host} port {port}: {error.strerror or error}.",
            advice="Choose another port with --port (0 selects a free one), or another --host.",
        ) from error
    return listening


class Stack:
    """The parts of one service on one data directory. With `redis_url` set, no Redis is started.

    `announce` is called once with the URL, when the service is ready; `log` with each line of the parts' output,
    prefixed with the part's name, and with reports on the parts. With `log_format` json each line is an object with the
    part's name in it.
    """

    def __init__(
        self,
        settings: Settings,
        *,
        host: str = DEFAULT_HOST,
        port: int = DEFAULT_PORT,
        announce: Callable[[str], None] = print,
        log: Callable[[str], None] = lambda line: print(line, file=sys.stderr, flush=True),
    ) -> None:
        self._settings, self._host, self._port = settings, host, port
        self._announce, self._log = announce, log
        self._parts: list[SupervisedChild] = []

    def run(self) -> None:
        """Start all parts, and return after SIGINT or SIGTERM once all have stopped.

        If a part cannot start (`UnavailableError`, `DependencyError`, `RecordVersionError`), the parts that did are
        stopped again.
        """
        with ExitStack() as cleanup:
            inbox = cleanup.enter_context(SignalInbox(signal.SIGINT, signal.SIGTERM, signal.SIGCHLD))
            lock = DirectoryLock(self._settings.data_dir)
            cleanup.callback(lock.close)
            listening = cleanup.enter_context(listen(self._host, self._port))
            redis_url = self._settings.redis_url
            if not redis_url:
                server = RedisServer(self._settings.data_dir / "redis", pass_fds=[lock.fd])
                redis_url = server.url
                started = [server.start_and_wait()]
                redis = SupervisedChild(lambda: started.pop() if started else server.start(), self._report)
                cleanup.callback(redis.stop, STOP_GRACE_S)
                self._parts.append(redis)
            environment = _environment(self._settings, redis_url)
            cleanup.callback(self._stop_parts, self._parts[:])
            self._start("api", ["service", "--fd", str(listening.fileno())], environment, lock, listening)
            self._start("worker", ["worker"], environment, lock)
            self._supervise(inbox, _url(listening))

    def _start(
        self,
        name: str,
        command: list[str],
        environment: dict[str, str],
        lock: DirectoryLock,
        listening: socket.socket | None = None,
    ) -> None:
        descriptors = [lock.fd] + ([listening.fileno()] if listening else [])

        def start() -> Child:
            return Child(
                name,
                python_command(*command),
                env={**environment, PART: name},
                pass_fds=descriptors,
                on_line=lambda line: self._forward(name, line),
            )

        self._parts.append(SupervisedChild(start, self._report))

    def _supervise(self, inbox: SignalInbox, url: str) -> None:
        ready = False
        while True:
            if inbox.wait(_SUPERVISE_EVERY_S) & {signal.SIGINT, signal.SIGTERM}:
                self._report("stopping")
                return
            for part in self._parts:
                if part.child.exit_code == FOREIGN_RECORD and part.child.name == _TELLS:
                    raise RecordVersionError("The record has the schema of another version of Meshdeform.")
                part.supervise()
            if not ready and _is_ready(url):
                ready = True
                self._announce(url)

    def _stop_parts(self, before: list[SupervisedChild]) -> None:
        """Stop API and worker together, before the Redis that they use."""
        parts = [part for part in self._parts if part not in before]
        deadline = time.monotonic() + STOP_GRACE_S
        for part in parts:
            part.ask_to_stop()
        for part in parts:
            part.stop(deadline - time.monotonic())

    def _report(self, text: str) -> None:
        self._forward("serve", text, __name__)

    def _forward(self, part: str, line: str, logger: str = "output") -> None:
        json = self._settings.log_format == "json"
        self._log(json_line(line, part, logger) if json else f"{part:<6} | {line}")


def _environment(settings: Settings, redis_url: str) -> dict[str, str]:
    """Return the settings that all parts must share, including those changed by flags."""
    return {
        "MESHDEFORM_DATA_DIR": str(Path(settings.data_dir).absolute()),
        "MESHDEFORM_DATABASE_URL": settings.resolved_database_url,
        "MESHDEFORM_STORAGE_URL": settings.resolved_storage_url,
        "MESHDEFORM_REDIS_URL": redis_url,
        "MESHDEFORM_MODEL": settings.model,
        "MESHDEFORM_DEVICE": settings.device,
        "MESHDEFORM_THREADS": str(settings.threads),
        "MESHDEFORM_AUTH": settings.auth,
        "MESHDEFORM_LOG_FORMAT": settings.log_format,
        "PYTHONUNBUFFERED": "1",
    }


def _url(listening: socket.socket) -> str:
    host, port = listening.getsockname()[:2]
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104 - not a bind: an address to open
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _is_ready(url: str) -> bool:
    try:
        with urllib.request.urlopen(f"{url}/readyz", timeout=2.0) as answer:  # noqa: S310 - our own http URL
            return bool(answer.status == 200)
    except (urllib.error.URLError, OSError):
        return False
