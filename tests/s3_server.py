"""A real S3 server for the tests: OpenStack Swift with its S3 interface, on loopback, its data in a temporary folder.

One node, one replica, four processes, started from the environment that scripts/test makes in tests/.swift. It checks
signatures for real, which mocks of S3 do not.
"""

from __future__ import annotations

import contextlib
import json
import os
import pwd
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx

from tests.servers import DEADLINE_S, NotInstalledError, wait_for_port

ENVIRONMENT = Path(__file__).resolve().parent / ".swift"

_SWIFT = """
[swift-hash]
swift_hash_path_suffix = tests
swift_hash_path_prefix = tests
[storage-policy:0]
name = gold
default = yes
"""
_BACKEND = """
[DEFAULT]
bind_ip = 127.0.0.1
bind_port = {port}
workers = 0
user = {user}
swift_dir = {folder}
devices = {folder}/devices
mount_check = false
fallocate_reserve = 0
recon_cache_path = {folder}
log_level = ERROR
log_address = /nonexistent
[pipeline:main]
pipeline = {name}-server
[app:{name}-server]
use = egg:swift#{name}
"""
_FILTERS = {
    "catch_errors": "",
    "gatekeeper": "",
    "healthcheck": "",
    # Nobody listens there: every request asks the servers themselves.
    "cache": "memcache_servers = 127.0.0.1:1",
    "listing_formats": "",
    # Short pages, so that a listing of a few dozen objects has several.
    "s3api": "location = {region}\nmax_bucket_listing = 10",
    "tempauth": "user_test_tester = {secret} .admin",
    "copy": "",
    "slo": "",
    "dlo": "",
}
_PROXY = """
[DEFAULT]
bind_ip = 127.0.0.1
bind_port = {port}
workers = 0
user = {user}
swift_dir = {folder}
log_level = ERROR
log_address = /nonexistent
[pipeline:main]
pipeline = {pipeline} proxy-server
[app:proxy-server]
use = egg:swift#proxy
account_autocreate = true
"""
# Rings say which device has what: one device each.
_RINGS = """
import json, sys
from swift.common.ring import RingBuilder
folder, ports = sys.argv[1], json.loads(sys.argv[2])
for name, port in ports.items():
    builder = RingBuilder(4, 1, 0)
    address = {"ip": "127.0.0.1", "port": port, "replication_ip": "127.0.0.1", "replication_port": port}
    builder.add_dev({"id": 0, "region": 1, "zone": 1, "device": "d1", "weight": 1.0, "meta": "", **address})
    builder.rebalance()
    builder.get_ring().save(f"{folder}/{name}.ring.gz")
"""


@dataclass(frozen=True)
class S3Server:
    """Where it is and who may ask."""

    port: int
    key: str = "test:tester"
    secret: str = "secret12345"
    region: str = "us-east-1"

    @property
    def endpoint(self) -> str:
        """Its URL."""
        return f"http://127.0.0.1:{self.port}"

    def settings(self) -> dict[str, str]:
        """The environment variables that lead to it."""
        return {
            "AWS_ENDPOINT_URL": self.endpoint,
            "AWS_ACCESS_KEY_ID": self.key,
            "AWS_SECRET_ACCESS_KEY": self.secret,
            "AWS_REGION": self.region,
            "AWS_ALLOW_HTTP": "true",
        }

    def make_bucket(self, name: str) -> None:
        """Make a bucket; there is none yet."""
        from datetime import timedelta

        import obstore
        from obstore.store import S3Store

        store = S3Store(
            name,
            endpoint=self.endpoint,
            access_key_id=self.key,
            secret_access_key=self.secret,
            region=self.region,
            client_options={"allow_http": True},
        )
        httpx.put(obstore.sign(store, "PUT", "", timedelta(minutes=1))).raise_for_status()


@contextlib.contextmanager
def s3_server(folder: Path) -> Iterator[S3Server]:
    """Run a Swift that speaks S3."""
    python = ENVIRONMENT / "bin/python"
    if not (ENVIRONMENT / "installed").is_file():
        raise NotInstalledError("OpenStack Swift, the S3 server of the tests, is not installed (scripts/test does it)")
    _check_attributes(folder)
    ports = dict(zip(("account", "container", "object", "proxy"), _free_ports(4), strict=True))
    _configure(folder, ports)
    subprocess.run([python, "-c", _RINGS, folder, json.dumps(ports)], check=True, env=_environment(folder))
    children: list[tuple[int, subprocess.Popen[bytes], Path]] = []
    try:
        for name, port in ports.items():
            log = folder / f"{name}.log"
            with log.open("wb") as output:
                child = subprocess.Popen(
                    [python, ENVIRONMENT / f"bin/swift-{name}-server", folder / f"{name}.conf"],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=output,
                    env=_environment(folder),
                    start_new_session=True,
                )
            children.append((port, child, log))
        for port, child, log in children:
            wait_for_port(port, child, log)
        server = S3Server(ports["proxy"])
        _wait_until_healthy(server, children[-1][2])
        yield server
    finally:
        for _, child, _ in children:
            _stop(child)


def _configure(folder: Path, ports: dict[str, int]) -> None:
    (folder / "devices/d1").mkdir(parents=True)
    (folder / "swift.conf").write_text(_SWIFT)
    known = {"folder": folder, "user": _user(), "region": S3Server.region, "secret": S3Server.secret}
    for name, port in ports.items():
        if name != "proxy":
            (folder / f"{name}.conf").write_text(_BACKEND.format(name=name, port=port, **known))
    filters = "".join(
        f"[filter:{name}]\nuse = egg:swift#{'memcache' if name == 'cache' else name}\n{options.format(**known)}\n"
        for name, options in _FILTERS.items()
    )
    proxy = _PROXY.format(port=ports["proxy"], pipeline=" ".join(_FILTERS), **known)
    (folder / "proxy.conf").write_text(proxy + filters)


def _environment(folder: Path) -> dict[str, str]:
    # Not the caller's: a variable for another Python would lead it astray.
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return {**kept, "SWIFT_DIR": str(folder)}


def _user() -> str:
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        raise NotInstalledError("OpenStack Swift needs a user with a name, and this one has none") from None


def _check_attributes(folder: Path) -> None:
    """Swift keeps what it knows of an object in attributes of the file."""
    probe = folder / "probe"
    probe.touch()
    try:
        os.setxattr(probe, "user.swift.metadata", b"x" * 1000)
    except (OSError, AttributeError):
        raise NotInstalledError(f"OpenStack Swift needs extended attributes, which {folder} has not") from None


def _free_ports(count: int) -> list[int]:
    """Ports on loopback that nobody listens on now, no two the same."""
    with contextlib.ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(count)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [int(probe.getsockname()[1]) for probe in probes]


def _wait_until_healthy(server: S3Server, log: Path) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline:
        with contextlib.suppress(httpx.TransportError):
            if httpx.get(f"{server.endpoint}/healthcheck").is_success:
                return
        time.sleep(0.05)
    raise RuntimeError(f"Swift is not healthy:\n{log.read_text(errors='replace')[-2000:]}")


def _stop(child: subprocess.Popen[bytes]) -> None:
    """End the child with whatever it started."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(timeout=10)
            return
