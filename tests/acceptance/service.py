"""A real `meshdeform serve` for the tests: started, asked over HTTP, hit by real signals, and always cleaned up."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, TypeVar

import httpx
import psutil

from meshdeform.errors import UnavailableError
from meshdeform.requests.groups import grouped

T = TypeVar("T")
DEADLINE_S = 240.0
SMALLER = Path(__file__).parents[1] / "smaller"
"""On the module path of a process, its jobs draw small previews and measure with few samples."""
TERMINAL = {"succeeded", "failed", "canceled", "expired"}


def until(what: str, value: Callable[[], T | None], *, deadline_s: float = DEADLINE_S) -> T:
    """Return the first true value, or fail saying what did not happen. A part that is away is asked again."""
    deadline, pause_s = time.monotonic() + deadline_s, 0.02
    while True:
        with contextlib.suppress(UnavailableError, httpx.TransportError):
            if result := value():
                return result
        assert time.monotonic() < deadline, f"in {deadline_s:g} s this did not happen: {what}"
        time.sleep(pause_s)
        # A request or a picture of the page each time: what is waited for needs the processor more.
        pause_s = min(1.5 * pause_s, 0.25)


def smaller() -> dict[str, str]:
    """What puts `SMALLER` on the module path of a process."""
    return {"PYTHONPATH": os.pathsep.join(filter(None, [str(SMALLER), os.environ.get("PYTHONPATH")]))}


def lives(process: psutil.Process) -> bool:
    """Whether it still runs; one that is dead and not yet asked for its exit code does not."""
    with contextlib.suppress(psutil.NoSuchProcess):
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return False


class Gate:
    """The files of the failpoint `pause:PATH`, at which processes wait."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._reached, self._go = Path(f"{path}.reached"), Path(f"{path}.go")

    def open(self) -> None:
        """Let everybody pass."""
        self._go.touch()

    def close(self) -> None:
        """Stop the next one that arrives."""
        self._reached.unlink(missing_ok=True)
        self._go.unlink(missing_ok=True)

    def wait(self) -> None:
        """Return when somebody waits at the closed gate."""
        until(f"a process waits at {self.path.name}", self._reached.exists)


class Service:
    """One `meshdeform serve` with its children.

    `held_jobs` stops jobs at `gate`, unless the settings name other failpoints.
    """

    def __init__(self, data_dir: Path, environment: Mapping[str, str], flags: Sequence[str] = ()) -> None:
        self.data_dir = data_dir
        self.gate = Gate(data_dir.with_name(f"{data_dir.name}.gate"))
        self.gate.open()
        self.output: list[str] = []
        self.errors: list[str] = []
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "meshdeform", "serve", "--port", "0", "--data-dir", str(data_dir), *flags],
            env={
                **os.environ,
                **smaller(),
                "MESHDEFORM_THREADS": "1",
                "MESHDEFORM_LEASE_S": "5",
                "MESHDEFORM_FAILPOINTS": f"worker.step=pause:{self.gate.path}",
                **environment,
            },
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.pid = self._process.pid
        streams = ((self._process.stdout, self.output), (self._process.stderr, self.errors))
        self._readers = [threading.Thread(target=_collect, args=each, daemon=True) for each in streams]
        for reader in self._readers:
            reader.start()
        self._seen: set[psutil.Process] = set()
        self.http = httpx.Client(timeout=DEADLINE_S)
        try:
            url = until("serve says where it listens", self._url)
        except AssertionError:
            self.clean_up()
            raise AssertionError(f"serve did not get ready:\n{self.log}") from None
        self.http.base_url = httpx.URL(url)

    @property
    def log(self) -> str:
        """What it printed, for a failing test."""
        return "".join([*self.output, *self.errors])

    def _url(self) -> str | None:
        assert self._process.poll() is None, self.log
        found = re.search(r"http://\S+:\d+", "".join(self.output))
        return found.group() if found else None

    def family(self) -> set[psutil.Process]:
        """Every process below serve that has been seen and still lives."""
        with contextlib.suppress(psutil.NoSuchProcess):
            self._seen |= set(psutil.Process(self.pid).children(recursive=True))
        return {process for process in self._seen if lives(process)}

    def part(self, *words: str) -> psutil.Process:
        """The process whose command line ends like this, as soon as there is one."""

        def find() -> psutil.Process | None:
            for process in self.family():
                with contextlib.suppress(psutil.Error):
                    if tuple(process.cmdline()[-len(words) :]) == words:
                        return process
            return None

        return until(f"a process {' '.join(words)}", find)

    def submit(self, asset: Path, request: Mapping[str, Any], target: Path | None = None) -> str:
        """Post a job and return its id."""
        answer = self.post(asset.read_bytes(), asset.name, request, target)
        assert answer.status_code == 202, answer.text
        return str(answer.json()["id"])

    def post(
        self, asset: bytes, filename: str, request: Mapping[str, Any], target: Path | None = None
    ) -> httpx.Response:
        """Post a job; one with a prompt keeps its front unless it says more: the search takes as long as the rest."""
        if "prompt" in request:
            request = {**request, "params": grouped({"orientation": "keep", **request.get("params", {})})}
        files: dict[str, Any] = {"asset": (filename, asset)}
        if target is not None:
            files["target"] = (target.name, target.read_bytes())
        return self.http.post("/v1/jobs", files=files, data={"request": json.dumps(request)})

    def job(self, job_id: str) -> dict[str, Any]:
        """The job as it stands."""
        answer = self.http.get(f"/v1/jobs/{job_id}")
        assert answer.status_code == 200, answer.text
        return dict(answer.json())

    def when(self, job_id: str, what: str, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the job as soon as the condition is true of it."""

        def look() -> dict[str, Any] | None:
            job = self.job(job_id)
            return job if condition(job) else None

        try:
            return until(what, look)
        except AssertionError as error:
            raise AssertionError(f"{error}; the job: {self.job(job_id)}\n{self.log}") from None

    def at_step(self, job_id: str, step: int) -> dict[str, Any]:
        """Return the job once it has done so many steps, in whatever attempt; it must not have ended before."""
        job = self.when(
            job_id,
            f"step {step}",
            lambda job: job["state"] in TERMINAL or job["progress"]["step"] >= step,
        )
        assert job["state"] == "running", f"too late: {job}"
        return job

    def finished(self, job_id: str) -> dict[str, Any]:
        """Return the job once it is in a terminal state."""
        return self.when(job_id, "a terminal state", lambda job: job["state"] in TERMINAL)

    @contextlib.contextmanager
    def held_jobs(self) -> Iterator[None]:
        """Stop each job after its next step until the block ends."""
        self.gate.close()
        try:
            yield
        finally:
            self.gate.open()

    def artifact(self, job_id: str, name: str) -> bytes:
        """Download an artifact."""
        answer = self.http.get(f"/v1/jobs/{job_id}/artifacts/{name}")
        assert answer.status_code == 200, answer.text
        return answer.content

    def send(self, number: signal.Signals) -> None:
        """Send serve a signal; remembers its family first."""
        self.family()
        os.kill(self.pid, number)

    def wait(self) -> int:
        """Return serve's exit code."""
        return self._process.wait(timeout=DEADLINE_S)

    def clean_up(self) -> None:
        """End everything, whatever the test left."""
        self.http.close()
        family = self.family()
        if self._process.poll() is None:
            self._process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=60.0)
            self._process.kill()
        for process in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        self._process.wait()
        for reader in self._readers:
            reader.join()


def _collect(stream: IO[str], lines: list[str]) -> None:
    with stream:
        lines.extend(stream)


@contextlib.contextmanager
def serving(data_dir: Path, *flags: str, **environment: str) -> Iterator[Service]:
    """A service for the block."""
    service = Service(data_dir, environment, flags)
    try:
        yield service
    finally:
        service.clean_up()
