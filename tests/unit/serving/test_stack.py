"""What `serve` decides before anything starts: the address, and what its parts are told."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from meshdeform.errors import UnavailableError
from meshdeform.serving.access import is_loopback, needs_keys
from meshdeform.serving.stack import _environment, _url, listen
from meshdeform.settings import Settings
from tests.cases import each_case


def test_port_0_takes_a_free_one() -> None:
    with listen("127.0.0.1", 0) as listening:
        port = listening.getsockname()[1]
        assert port > 0
        assert _url(listening) == f"http://127.0.0.1:{port}"
        with socket.create_connection(("127.0.0.1", port), timeout=5):
            pass


def test_the_address_to_open_is_never_the_wildcard() -> None:
    with listen("0.0.0.0", 0) as listening:
        assert _url(listening) == f"http://127.0.0.1:{listening.getsockname()[1]}"


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


# Who can reach an address, and whether requests at it need a key.


@each_case("address", ["127.0.0.1", "127.8.9.10", "::1", "::ffff:127.0.0.1", "localhost", "::1%lo"])
def test_loopback_needs_no_key(address: str) -> None:
    assert is_loopback(address)
    assert not needs_keys("auto", address)


@each_case(
    "address",
    [
        "0.0.0.0",
        "::",
        "192.0.2.7",
        "10.0.0.1",
        "::ffff:192.0.2.7",
        "fe80::1%eth0",
        "example.com",
        "",
        "127.0.0.1.nip.io",
    ]
    + ["/run/meshdeform.sock", "localhost.example.com", None],
)
def test_whatever_is_not_certainly_loopback_needs_one(address: str | None) -> None:
    assert not is_loopback(address)
    assert needs_keys("auto", address)


@each_case("address", ["127.0.0.1", "0.0.0.0", None])
def test_on_and_off_ask_no_address(address: str | None) -> None:
    assert needs_keys("on", address)
    assert not needs_keys("off", address)
