"""Real servers for the tests, each a child of the test process on loopback with its data in a temporary folder."""

from __future__ import annotations

import contextlib
import os
import pwd
import shutil
import signal
import socket
import subprocess
import threading
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

from meshdeform.errors import DependencyError
from meshdeform.serving.redis_server import find_redis_server

DEADLINE_S = 240.0


class NotInstalledError(Exception):
    """A program that a server needs is not on this machine; the message says how to get it."""


def free_port() -> int:
    """Return a TCP port on loopback that nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for_port(port: int, child: subprocess.Popen[bytes], log: Path) -> None:
    """Return when something accepts connections; fail with the log when the child ends or time is up."""
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline and child.poll() is None:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
            return
        time.sleep(0.02)
    raise RuntimeError(f"{child.args} does not answer on port {port}:\n{log.read_text(errors='replace')[-2000:]}")


def _stop(child: subprocess.Popen[bytes]) -> None:
    child.terminate()
    try:
        child.wait(timeout=10)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


class RedisServer:
    """A Redis on a port of its own that can be killed and started again. It keeps nothing: the worst of all Redises."""

    def __init__(self, folder: Path) -> None:
        try:
            self._program = find_redis_server()
        except DependencyError as missing:
            raise NotInstalledError(missing.advice_text) from None
        self._folder, self.port = folder, free_port()
        self._child: subprocess.Popen[bytes] | None = None
        self.url = f"redis://127.0.0.1:{self.port}/0"

    def start(self) -> None:
        """Start it and return when it answers."""
        command = [self._program, "--port", str(self.port), "--bind", "127.0.0.1", "--dir", str(self._folder)]
        command += ["--save", "", "--appendonly", "no", "--protected-mode", "no"]
        log = self._folder / "redis.log"
        with log.open("ab") as output:
            self._child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output)
        wait_for_port(self.port, self._child, log)

    @property
    def pid(self) -> int:
        """The process id of the started server."""
        assert self._child is not None
        return self._child.pid

    def kill(self) -> None:
        """End it with SIGKILL."""
        if self._child is not None:
            self._child.kill()
            self._child.wait()

    def stop(self) -> None:
        """End it in order."""
        if self._child is not None:
            _stop(self._child)


@contextlib.contextmanager
def redis_server(folder: Path) -> Iterator[str]:
    """Run a Redis without persistence and give its URL."""
    server = RedisServer(folder)
    server.start()
    try:
        yield server.url
    finally:
        server.stop()


def _postgres_binaries() -> Path:
    """Return the folder of `initdb`: Debian keeps it off PATH, one folder for each major version."""
    if found := shutil.which("initdb"):
        return Path(found).resolve().parent
    versions = [path.parent for path in Path("/usr/lib/postgresql").glob("*/bin/initdb")]
    if not versions:
        raise NotInstalledError("PostgreSQL is not installed (apt install postgresql)")
    return max(versions, key=lambda path: int(path.parent.name))


def _unprivileged() -> list[str]:
    """Return what to put before a command: PostgreSQL refuses to run as root."""
    if os.geteuid() != 0:
        return []
    for user in ("postgres", "nobody"):
        with contextlib.suppress(KeyError):
            pwd.getpwnam(user)
            if runuser := shutil.which("runuser", path=f"{os.environ['PATH']}:/usr/sbin:/sbin"):
                return [runuser, "-u", user, "--"]
    raise NotInstalledError("PostgreSQL does not run as root, and there is no runuser with a user postgres or nobody")


class PostgresServer:
    """A PostgreSQL cluster of its own that can be killed and started again; the superuser is `meshdeform`.

    Others may enter its folder: PostgreSQL does not run as root. Unless it is `durable` it does not sync, and loses
    what it has when the machine dies, not when it does. A `standby_of` another one is a copy of it that follows it,
    once it is started, until it is promoted.
    """

    def __init__(
        self,
        folder: Path,
        *,
        durable: bool = False,
        options: dict[str, str] | None = None,
        standby_of: PostgresServer | None = None,
    ) -> None:
        self._binaries, self._runas = _postgres_binaries(), _unprivileged()
        self._options = [word for name, value in (options or {}).items() for word in ("-c", f"{name}={value}")]
        self.folder, self._data, self._durable = folder, folder / "data", durable
        self.port = free_port()
        self._child: subprocess.Popen[bytes] | None = None
        if self._runas:
            user = pwd.getpwnam(self._runas[2])
            os.chown(folder, user.pw_uid, user.pw_gid)
        make: list[str | Path] = [self._binaries / "initdb", "-D", self._data, "-U", "meshdeform", "-A", "trust"]
        make += ["-E", "UTF8", "-N", "--locale=C"]
        if standby_of is not None:
            make = [self._binaries / "pg_basebackup", "-R", "-c", "fast", "-D", self._data, "-d", standby_of.url]
        subprocess.run([*self._runas, *make], check=True, cwd=folder, stdout=subprocess.DEVNULL)

    @property
    def url(self) -> str:
        """The database `postgres` on it."""
        return f"postgresql://meshdeform@127.0.0.1:{self.port}/postgres"

    def start(self) -> None:
        """Start it and return when it answers."""
        log = self.folder / "postgres.log"
        command = [*self._runas, self._binaries / "postgres", "-D", self._data, "-k", self.folder]
        command += ["-h", "127.0.0.1", "-p", str(self.port), *self._options] + ([] if self._durable else ["-F"])
        with log.open("ab") as output:
            self._child = subprocess.Popen(
                command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
        wait_for_port(self.port, self._child, log)
        self._wait_for_recovery(log)

    @property
    def pid(self) -> int:
        """The process id of the started server, the parent of all its processes."""
        assert self._child is not None
        found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(self._child.pid)], check=False, capture_output=True)
        # Not run as root, the server is our own child; else `runuser` is between.
        return int(found.stdout.split()[0]) if self._runas else self._child.pid

    def _wait_for_recovery(self, log: Path) -> None:
        # After a crash it accepts connections long before it has read its log, and refuses every session until then.
        command = [self._binaries / "pg_isready", "-q", "-t", "1", "-h", "127.0.0.1", "-p", str(self.port)]
        deadline = time.monotonic() + DEADLINE_S
        while subprocess.run(command, check=False, cwd=self.folder).returncode != 0:
            if time.monotonic() > deadline or (self._child is not None and self._child.poll() is not None):
                raise RuntimeError(f"PostgreSQL does not recover:\n{log.read_text(errors='replace')[-2000:]}")
            time.sleep(0.02)

    def promote(self) -> None:
        """Make a standby take writes."""
        self._control("promote")

    def stop(self) -> None:
        """End it in order: every session is ended."""
        self._control("stop", "-m", "fast")
        if self._child is not None:
            _stop(self._child)

    def kill(self) -> None:
        """End it without a checkpoint and without waiting for anybody, as a crash does."""
        self._control("stop", "-m", "immediate")
        if self._child is not None:
            _stop(self._child)

    def _control(self, *words: str) -> None:
        command = [*self._runas, self._binaries / "pg_ctl", "-D", self._data, "-s", *words]
        subprocess.run(command, check=False, cwd=self.folder)


@contextlib.contextmanager
def postgres_server(folder: Path) -> Iterator[int]:
    """Run a PostgreSQL cluster of its own, without fsync, and give its port; the superuser is `meshdeform`."""
    server = PostgresServer(folder)
    server.start()
    try:
        yield server.port
    finally:
        server.kill()


@contextlib.contextmanager
def postgres_database(port: int) -> Iterator[str]:
    """Make a database of its own in a running PostgreSQL, and drop it afterwards; gives its URL."""
    import sqlalchemy as sa

    server, name = f"postgresql+pg8000://meshdeform@127.0.0.1:{port}", f"test_{uuid.uuid4().hex}"
    engine = sa.create_engine(f"{server}/postgres", isolation_level="AUTOCOMMIT", poolclass=sa.NullPool)
    with engine.connect() as connection:
        connection.execute(sa.text(f"CREATE DATABASE {name}"))
    yield f"{server}/{name}"
    with engine.connect() as connection:
        connection.execute(sa.text(f"DROP DATABASE {name} WITH (FORCE)"))
    engine.dispose()


class PgBouncer:
    """A PgBouncer in front of a PostgreSQL, which shares its `connections` between the transactions of all clients."""

    def __init__(self, folder: Path, server: PostgresServer | int, connections: int = 4) -> None:
        program = shutil.which("pgbouncer", path=f"{os.environ['PATH']}:/usr/sbin:/sbin")
        if program is None:
            raise NotInstalledError("PgBouncer is not installed (apt install pgbouncer)")
        self.port = free_port()
        behind = server if isinstance(server, int) else server.port
        users, settings = folder / "users.txt", folder / "pgbouncer.ini"
        users.write_text('"meshdeform" ""\n')
        settings.write_text(
            f"[databases]\n* = host=127.0.0.1 port={behind} user=meshdeform\n"
            f"[pgbouncer]\nlisten_addr = 127.0.0.1\nlisten_port = {self.port}\nunix_socket_dir =\n"
            f"auth_type = trust\nauth_file = {users}\npool_mode = transaction\nmax_client_conn = 5000\n"
            f"default_pool_size = {connections}\nserver_round_robin = 1\n"
        )
        # Each client is an open file.
        raised = ["sh", "-c", 'ulimit -n "$(ulimit -Hn)"; exec "$0" "$1"', program]
        self._command = [*_unprivileged(), *raised, str(settings)]
        if os.geteuid() == 0:
            user = pwd.getpwnam(self._command[2])
            for path in (folder, users, settings):
                os.chown(path, user.pw_uid, user.pw_gid)
        self._folder = folder
        self._child: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """The database `postgres` behind it."""
        return f"postgresql://meshdeform@127.0.0.1:{self.port}/postgres"

    def start(self) -> None:
        """Start it and return when it answers."""
        log = self._folder / "pgbouncer.log"
        with log.open("ab") as output:
            self._child = subprocess.Popen(
                self._command, cwd=self._folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
        wait_for_port(self.port, self._child, log)

    def kill(self) -> None:
        """End it with SIGKILL."""
        if self._child is not None:
            # `runuser`, where it is between, ends with its child.
            below = subprocess.run(
                ["ps", "-o", "pid=", "--ppid", str(self._child.pid)], check=False, capture_output=True
            )
            for pid in [int(word) for word in below.stdout.split()] or [self._child.pid]:
                os.kill(pid, signal.SIGKILL)
            self._child.wait()

    def stop(self) -> None:
        """End it."""
        if self._child is not None:
            _stop(self._child)


@contextlib.contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[None]:
    """Have a file system of that size on the folder."""
    mount = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, check=False, capture_output=True).returncode:
        raise NotInstalledError("a small file system cannot be mounted here (it takes root)")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@contextlib.contextmanager
def kept_full(ballast: Path) -> Iterator[None]:
    """Fill a disk, and again whenever something is deleted from it; then free it."""
    _fill(ballast)
    done = threading.Event()

    def refill() -> None:
        while not done.wait(0.001):
            _fill(ballast)

    filler = threading.Thread(target=refill)
    filler.start()
    try:
        yield
    finally:
        done.set()
        filler.join()
        ballast.unlink()


def _fill(path: Path) -> None:
    """Write until nothing more goes in."""
    with path.open("ab", buffering=0) as file:
        for size in (65536, 512, 1):
            try:
                while True:
                    file.write(b"\0" * size)
            except OSError:
                continue
