"""The shell commands of the compose file, run without a container engine against the real servers of the tests."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest
import redis
import yaml

from tests.cases import each_case
from tests.servers import find_redis_server, free_port, wait_for_port


def services(repository: Path) -> dict[str, dict[str, Any]]:
    text = (repository / "docker-compose.yml").read_text().replace("$$", "$")
    return dict(yaml.safe_load(text)["services"])


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
@each_case(("answer", "good"), [(200, True), (409, True), (403, False), (500, False)])
def test_the_bucket_is_asked_for_with_a_signature(repository: Path, answer: int, good: bool) -> None:
    asked: list[tuple[str, str]] = []

    class Store(BaseHTTPRequestHandler):
        def do_PUT(self) -> None:
            asked.append((self.path, self.headers["Authorization"]))
            self.send_response(answer)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *args: object) -> None:
            """Say nothing."""

    with HTTPServer(("127.0.0.1", 0), Store) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        script = services(repository)["bucket"]["command"][0]
        script = script.replace("http://s3:7070", f"http://127.0.0.1:{server.server_port}")
        keys = {"S3_ACCESS_KEY": "studio", "S3_SECRET_KEY": "s3cret"}
        done = subprocess.run(["sh", "-c", script], env={**os.environ, **keys}, capture_output=True, check=False)
        server.shutdown()
    assert (done.returncode == 0) == good, done.stderr
    ((path, signature),) = asked
    assert path == "/meshdeform"
    assert re.match(r"AWS4-HMAC-SHA256 Credential=studio/\d{8}/us-east-1/s3/aws4_request, ", signature)
    assert "x-amz-content-sha256" in signature
    assert good or f"making the bucket: {answer}".encode() in done.stderr


@contextlib.contextmanager
def compose_redis(repository: Path, folder: Path, password: str) -> Iterator[tuple[int, int]]:
    """Run Redis by the command of the compose file, and give its port and the id of its process."""
    folder.mkdir()
    port = free_port()
    script = services(repository)["redis"]["command"][-1].replace("redis-server -", f"{find_redis_server()} -")
    script = script.rstrip() + f" --port {port} --bind 127.0.0.1 --dir {folder}"
    log = folder / "redis.log"
    with log.open("wb") as output:
        # The shell does not hand a signal on to what it started: the whole group is ended.
        environment = {**os.environ, "REDIS_PASSWORD": password}
        child = subprocess.Popen(["sh", "-c", script], env=environment, stdout=output, start_new_session=True)
    try:
        wait_for_port(port, child, log)
        yield port, child.pid
    finally:
        os.killpg(child.pid, signal.SIGTERM)
        child.wait(30)


def test_redis_asks_for_its_password_and_keeps_what_it_is_told(repository: Path, tmp_path: Path) -> None:
    with compose_redis(repository, tmp_path / "redis", "s3cret") as (port, process):
        with pytest.raises(redis.AuthenticationError):
            redis.Redis(port=port).ping()
        told = redis.Redis(port=port, password="s3cret", decode_responses=True)
        assert told.config_get("append*")["appendonly"] == "yes"
        assert told.config_get("appendfsync") == {"appendfsync": "everysec"}
        assert told.config_get("maxmemory-policy") == {"maxmemory-policy": "noeviction"}
        assert b"s3cret" not in Path(f"/proc/{process}/cmdline").read_bytes()
