"""What `serve` decides before anything starts: the address, and what its parts are told."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import psutil
import pytest

from meshdeform.errors import UnavailableError
from meshdeform.serving.access import is_loopback, needs_keys
from meshdeform.serving.processes import Backoff, Child, SignalInbox, SupervisedChild
from meshdeform.serving.stack import DirectoryLock, _environment, _url, listen
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.waiting import until


def test_port_0_takes_a_free_one_and_the_address_to_open_is_never_the_wildcard() -> None:
    for host in ("127.0.0.1", "0.0.0.0"):
        with listen(host, 0) as listening:
            port = listening.getsockname()[1]
            assert port > 0
            assert _url(listening) == f"http://127.0.0.1:{port}"
            with socket.create_connection(("127.0.0.1", port), timeout=5):
                pass


@each_case("host", ["127.0.0.1", "no.such.host.invalid"])
def test_an_address_that_cannot_be_had_is_one_clear_error(host: str) -> None:
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UnavailableError, match=f"Cannot listen on {host} port {port}") as caught:
            listen(host, port)
    assert "--port" in caught.value.advice_text


def test_every_part_is_told_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    settings = Settings(data_dir=Path("data"), model="sd", threads=2)
    told = _environment(settings, "unix:///redis.sock")
    for name, value in told.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir("/")  # a part may run anywhere
    heard = Settings()
    assert heard.data_dir == tmp_path / "data"
    assert heard.resolved_database_url == f"sqlite:///{tmp_path}/data/meshdeform.sqlite"
    assert heard.resolved_storage_url == f"{tmp_path}/data/objects"
    assert (heard.redis_url, heard.model, heard.threads) == ("unix:///redis.sock", "sd", 2)


def test_a_taken_port_ends_serve_with_one_line_and_starts_nothing(tmp_path: Path) -> None:
    with listen("127.0.0.1", 0) as taken:
        command = [sys.executable, "-P", "-m", "meshdeform", "serve", "--port", str(taken.getsockname()[1])]
        result = subprocess.run(
            [*command, "--data-dir", tmp_path / "data"], capture_output=True, text=True, check=False
        )
    assert result.returncode == 4
    assert "Cannot listen on" in result.stderr
    assert "Traceback" not in result.stderr
    assert [p.name for p in (tmp_path / "data").iterdir()] == ["serve.lock"]


@each_case(
    ("address", "loopback"),
    [
        *((address, True) for address in ("127.8.9.10", "::1", "::ffff:127.0.0.1", "localhost", "::1%lo")),
        *((address, False) for address in ("0.0.0.0", "::", "192.0.2.7", "::ffff:192.0.2.7", "fe80::1%eth0", "")),
        *((address, False) for address in ("127.0.0.1.nip.io", "localhost.example.com", "/run/a.sock", None)),
    ],
)
def test_whatever_is_not_certainly_loopback_needs_keys(address: str | None, loopback: bool) -> None:
    assert is_loopback(address) is loopback
    assert needs_keys("auto", address) is not loopback
    assert needs_keys("on", address)
    assert not needs_keys("off", address)


# Who can reach an address, and whether requests at it need a key.


# Children that do not outlive us, restarts with back-off, and signals that wait to be read.


SLEEP = [sys.executable, "-c", "import time; time.sleep(600)"]


def test_a_child_reads_its_input_and_each_line_of_it_arrives() -> None:
    lines: list[str] = []
    program = "import sys; print('zwei äö', file=sys.stderr); print(sys.stdin.read() + 'no newline', end='')"
    child = Child("talker", [sys.executable, "-X", "utf8", "-c", program], stdin=b"one\n", on_line=lines.append)
    until(lambda: child.exit_code is not None)
    assert child.stop(1.0) == 0
    assert sorted(lines) == ["no newline", "one", "zwei äö"]
    missing = Child("nothing", ["/no/such/program"], on_line=lambda line: None)
    until(lambda: missing.exit_code is not None)
    assert missing.exit_code == 127


def test_a_deaf_child_is_killed_with_what_it_started() -> None:
    program = (
        "import signal, subprocess, sys, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "print(subprocess.Popen(['sleep', '600']).pid, flush=True)\n"
        "time.sleep(600)"
    )
    lines: list[str] = []
    child = Child("deaf", [sys.executable, "-c", program], on_line=lines.append)
    until(lambda: bool(lines))
    grandchild = psutil.Process(int(lines[0]))
    assert child.stop(0.05) == -signal.SIGKILL
    until(lambda: not grandchild.is_running() or grandchild.status() == psutil.STATUS_ZOMBIE)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a child of its parent's death")
def test_a_child_dies_with_a_parent_that_was_killed() -> None:
    program = (
        "import time; from meshdeform.serving.processes import Child\n"
        f"print(Child('sleeper', {SLEEP!r}).pid, flush=True); time.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
        until(lambda: not child.is_running() or child.status() == psutil.STATUS_ZOMBIE)


def test_the_wait_before_a_restart_doubles_and_is_forgiven() -> None:
    backoff = Backoff(first_s=1.0, longest_s=5.0, healthy_s=10.0)
    assert [backoff.after(0.1) for _ in range(4)] == [1.0, 2.0, 4.0, 5.0]
    assert backoff.after(11.0) == 1.0


def test_a_kept_child_comes_back() -> None:
    said: list[str] = []
    ended: list[int] = []
    kept = SupervisedChild(lambda: Child("sleeper", SLEEP), said.append, lambda: ended.append(kept.child.pid))
    first = kept.child.pid
    os.kill(first, signal.SIGKILL)

    def back() -> bool:
        kept.supervise()
        return kept.child.pid != first

    until(back)
    kept.stop(5.0)
    assert said == ["sleeper was ended by SIGKILL; starting it again in 0.5 s"]
    assert ended == [first]


def test_signals_wait_to_be_read() -> None:
    before = signal.getsignal(signal.SIGUSR1)
    with SignalInbox(signal.SIGUSR1, signal.SIGUSR2) as inbox:
        assert inbox.wait(0.0) == set()
        os.kill(os.getpid(), signal.SIGUSR1)
        assert inbox.wait(60.0) == {signal.SIGUSR1}
        threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGUSR2)).start()
        assert inbox.wait(60.0) == {signal.SIGUSR2}
    assert signal.getsignal(signal.SIGUSR1) is before


def test_a_directory_has_one_serve_and_the_next_waits_for_the_children_of_a_killed_one(tmp_path: Path) -> None:
    program = (
        "import pathlib, sys, time; from meshdeform.serving.stack import DirectoryLock; import subprocess\n"
        "lock = DirectoryLock(pathlib.Path(sys.argv[1]))\n"
        "print(subprocess.Popen(['sleep', '600'], pass_fds=(lock.fd,)).pid, flush=True); time.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", program, tmp_path], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        left = int(parent.stdout.readline())
        parent.kill()
        parent.wait()
        with pytest.raises(UnavailableError):
            DirectoryLock(tmp_path, patience_s=0.1)
        threading.Timer(0.2, os.kill, (left, signal.SIGKILL)).start()
        lock = DirectoryLock(tmp_path, patience_s=30.0)
    with pytest.raises(UnavailableError, match=rf"process {os.getpid()}\)"):
        DirectoryLock(tmp_path)
    lock.close()
    (tmp_path / "file").write_text("")
    with pytest.raises(UnavailableError, match="cannot be written"):
        DirectoryLock(tmp_path / "file" / "data")
