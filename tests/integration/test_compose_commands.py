"""The shell commands of the compose file, run without a container engine against the real servers of the tests."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
import redis
import yaml

from tests.acceptance.service import DEADLINE_S, SMALLER, TERMINAL, until
from tests.cases import each_case
from tests.s3_server import S3Server
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


def image(repository: Path, dockerfile: str) -> tuple[list[str], list[str], dict[str, str]]:
    """Return the entry point, the command and the environment that an image gives to its containers."""
    text = (repository / dockerfile).read_text().rpartition("\nFROM ")[2].replace("\\\n", " ")
    entry, command = (re.search(rf"^{word} (\[.*\])$", text, re.MULTILINE) for word in ("ENTRYPOINT", "CMD"))
    given = " ".join(re.findall(r"^ENV (.*)$", text, re.MULTILINE))
    assert command is not None
    return (
        json.loads(entry[1]) if entry else [],
        json.loads(command[1]),
        dict(word.split("=", 1) for word in shlex.split(given)),
    )


# What compose asks for: a root file system that is read-only but for one folder, no capabilities, no way to new ones.
CONFINED = """mount --bind "$0" "$0" && mount -o remount,ro,bind / &&
exec setpriv --bounding-set=-all --inh-caps=-all --no-new-privs "$@\""""
USER = ("--reuid=10001", "--regid=10001", "--clear-groups")


def confined(folder: Path, environment: dict[str, str]) -> list[str]:
    """Return what to put before a command so that it may do what it may in a container, as far as we may arrange it."""
    shell = ["unshare", "--mount", "sh", "-c", CONFINED, str(folder)]
    # As root without the rights of root, where the user of the image may not read the interpreter or the tree.
    for prefix in ([*shell, *USER], shell) if os.geteuid() == 0 else ():
        # By way of a shell, for `setpriv` itself still has the rights of root when it finds the interpreter.
        probe = [*prefix, "sh", "-c", 'exec "$@"', "--", sys.executable, "-c", "import meshdeform.settings"]
        with contextlib.suppress(OSError):
            if subprocess.run(probe, cwd="/", env=environment, capture_output=True, check=False).returncode == 0:
                return prefix
    return []


class Containers:
    """Runs the containers of the project as processes: their commands, their environment and nothing else of ours.

    The names of other containers, the folders that they can write to, and the published port are replaced by those of
    this machine (`places`); `secrets` is what `.env` says.
    """

    def __init__(self, repository: Path, folder: Path, secrets: dict[str, str], places: dict[str, str]) -> None:
        self._repository, self._secrets = repository, secrets
        self.port, self.log = free_port(), folder / "log"
        self._data = folder / "data"
        (self._data / "tmp").mkdir(parents=True)
        self._places = {**places, "/data": str(self._data), "=/tmp": f"={self._data}/tmp"}
        self._ours = {
            "PATH": os.environ["PATH"],
            "PYTHONPATH": f"{SMALLER}{os.pathsep}{repository}",
            "OMP_NUM_THREADS": "1",
            "MESHDEFORM_THREADS": "1",
        }
        self._confined = confined(self._data, self._ours)
        if USER[0] in self._confined:
            for path in (self._data, self._data / "tmp"):
                os.chown(path, 10001, 10001)

    def start(self, service: str, *words: str) -> subprocess.Popen[str]:
        """Start a container, with another command if words are given; it writes to `log`."""
        told = services(self._repository)[service]
        entry, command, environment = image(self._repository, told["build"]["dockerfile"])
        environment |= {name: filled(str(value), self._secrets) for name, value in told["environment"].items()}
        lines = "\n".join(f"{name}={value}" for name, value in {"HOME": "/home/meshdeform", **environment}.items())
        lines = re.sub("|".join(map(re.escape, self._places)), lambda match: self._places[match[0]], lines)
        program, *arguments = words or command
        assert program == "meshdeform"
        here = {"0.0.0.0": "127.0.0.1", "8765": str(self.port)}  # as the port is published
        arguments = ["-P", "-m", "meshdeform", *(here.get(word, word) for word in arguments)]
        with self.log.open("ab") as output:
            return subprocess.Popen(
                [*self._confined, *entry, sys.executable, *arguments],
                cwd=self._data,
                env={**dict(line.split("=", 1) for line in lines.split("\n")), **self._ours},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if words else output,
                stderr=output,
                text=True,
            )

    def output(self, service: str, *words: str) -> str:
        """Run a command in a container of its own, or in a running one, which is the same here; what it printed."""
        with self.start(service, *words) as process:
            printed, _ = process.communicate(timeout=DEADLINE_S)
        assert process.returncode == 0, self.log.read_text()
        return printed

    @contextlib.contextmanager
    def up(self, *others: str) -> Iterator[httpx.Client]:
        """Run the API and other services, and give a client of the API when it is healthy."""
        with contextlib.ExitStack() as stack:
            for name in (*others, "service"):
                child = stack.enter_context(self.start(name))
                stack.callback(child.terminate)
            http = stack.enter_context(httpx.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=DEADLINE_S))
            wait_for_port(self.port, child, self.log)
            assert http.get("/healthz").is_success
            yield http


def filled(text: str, secrets: dict[str, str]) -> str:
    """Return a value of the compose file with its variables, which the project's `.env` sets or a default."""

    def value(match: re.Match[str]) -> str:
        name, kind, otherwise = match.groups()
        assert kind == "-" or secrets.get(name), otherwise
        return secrets.get(name) or otherwise

    return re.sub(r"\$\{(\w+):([-?])([^}]*)\}", value, text)


@pytest.fixture
def containers(
    repository: Path, server_folder: Path, postgres_url: str, s3_server: S3Server, s3_store_url: str
) -> Iterator[Containers]:
    """The project with an `.env` that was filled in, on a PostgreSQL, a Redis and an S3 that run."""
    values = {"S3_ACCESS_KEY": s3_server.key, "S3_SECRET_KEY": s3_server.secret}
    names = re.findall(r"^(\w+)=", (repository / ".env.example").read_text(), re.MULTILINE)
    secrets = {name: values.get(name, f"{name.lower()}0") for name in names}
    folder = server_folder / f"compose-{uuid.uuid4().hex}"
    folder.mkdir()
    folder.chmod(0o755)
    with compose_redis(repository, folder / "redis", secrets["REDIS_PASSWORD"]) as (redis_port, _):
        places = {
            "@postgres:5432/meshdeform": "@" + postgres_url.partition("@")[2],
            "@redis:6379": f"@127.0.0.1:{redis_port}",
            "http://s3:7070": s3_server.endpoint,
            "http://127.0.0.1:7070": s3_server.endpoint,
            "s3://meshdeform": s3_store_url,
        }
        yield Containers(repository, folder, secrets, places)


def test_the_lines_of_the_readme_lead_to_a_service_that_takes_a_job_to_its_end(
    repository: Path, containers: Containers
) -> None:
    block = re.search(r"```sh\n(cp \.env\.example.*?)```", (repository / "README.md").read_text(), re.DOTALL)
    assert block is not None
    copy, make_key, up = (shlex.split(line, comments=True) for line in block[1].splitlines())
    assert copy == ["cp", ".env.example", ".env"]  # which the fixture has filled in
    assert make_key[:4] == ["docker", "compose", "run", "--rm"]
    assert up == ["docker", "compose", "up", "--build"]
    (key,) = containers.output(*make_key[4:]).split()
    with containers.up("worker") as http:
        assert http.get("/v1/jobs").status_code == 401
        http.headers["Authorization"] = f"Bearer {key}"
        files = {
            "asset": (repository / "examples/sphere.glb").read_bytes(),
            "request": json.dumps({"prompt": "a vase", "params": {"preset": "preview", "steps": 2}}),
        }
        answer = http.post("/v1/jobs", files={name: (f"{name}.glb", each) for name, each in files.items()})
        assert answer.status_code == 202, answer.text
        job = f"/v1/jobs/{answer.json()['id']}"
        # Longer than elsewhere: the kernels, which the image has, are compiled here first.
        ended = until("the job is over", lambda: TERMINAL & {http.get(job).json()["state"]}, deadline_s=300)
        assert ended == {"succeeded"}, containers.log.read_text()
        found = http.get(f"{job}/artifacts/result.glb", follow_redirects=True)
        assert found.content[:4] == b"glTF"


def test_without_a_key_the_service_stays_up_lets_nobody_in_and_says_what_to_do(containers: Containers) -> None:
    with containers.up() as http:
        assert http.get("/v1/jobs").status_code == 401
        (line,) = [line for line in containers.log.read_text().splitlines() if "no API key exists" in line]
        advice = re.search(r"docker compose exec ([\w -]+)", json.loads(line)["message"])
        assert advice is not None
        (key,) = containers.output(*advice[1].split()).split()
        assert http.get("/v1/jobs", headers={"Authorization": f"Bearer {key}"}).status_code == 200
