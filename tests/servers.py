"""Real servers for the tests, each a child of the test process on loopback with its data in a temporary folder."""

from __future__ import annotations

import contextlib
import os
import pwd
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from meshdeform.errors import DependencyError
from meshdeform.redis_server import find_redis_server

DEADLINE_S = 60.0


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


@contextlib.contextmanager
def redis_server(folder: Path) -> Iterator[str]:
    """Run a Redis without persistence and give its URL."""
    try:
        program = find_redis_server()
    except DependencyError as missing:
        raise NotInstalledError(missing.advice_text) from None
    port, log = free_port(), folder / "redis.log"
    command = [program, "--port", str(port), "--bind", "127.0.0.1", "--dir", str(folder)]
    with log.open("wb") as output:
        child = subprocess.Popen(
            [*command, "--save", "", "--appendonly", "no"], stdin=subprocess.DEVNULL, stdout=output, stderr=output
        )
    try:
        wait_for_port(port, child, log)
        yield f"redis://127.0.0.1:{port}/0"
    finally:
        _stop(child)


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


@contextlib.contextmanager
def postgres_server(folder: Path) -> Iterator[int]:
    """Run a PostgreSQL cluster of its own, without fsync, and give its port; the superuser is `meshdeform`."""
    binaries, runas = _postgres_binaries(), _unprivileged()
    data, log, port = folder / "data", folder / "postgres.log", free_port()
    if runas:
        user = pwd.getpwnam(runas[2])
        os.chown(folder, user.pw_uid, user.pw_gid)
    subprocess.run(
        [*runas, binaries / "initdb", "-D", data, "-U", "meshdeform", "-A", "trust", "-E", "UTF8", "-N", "--locale=C"],
        check=True,
        cwd=folder,
        stdout=subprocess.DEVNULL,
    )
    with log.open("wb") as output:
        child = subprocess.Popen(
            [*runas, binaries / "postgres", "-D", data, "-k", folder, "-h", "127.0.0.1", "-p", str(port), "-F"],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )
    try:
        wait_for_port(port, child, log)
        yield port
    finally:
        subprocess.run(
            [*runas, binaries / "pg_ctl", "-D", data, "stop", "-m", "immediate", "-s"], check=False, cwd=folder
        )
        _stop(child)
