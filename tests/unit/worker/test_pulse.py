"""The supervisor sees whether its worker moves, and is not deceived by its own sleep."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from meshdeform.settings import Settings
from worker.health import PULSE, Pulse, PulseMonitor, sign_of_life


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def monitor(clock: Clock) -> Iterator[PulseMonitor]:
    made = PulseMonitor(clock)
    yield made
    made.close()


def watch(monitor: PulseMonitor, clock: Clock, seconds: int) -> float:
    """Look four times a second, and return what was seen last."""
    silent_s = 0.0
    for _ in range(4 * seconds):
        clock.now += 0.25
        silent_s = monitor.silent_s()
    return silent_s


def test_silence_adds_up_from_the_start_and_ends_with_a_beat(monitor: PulseMonitor, clock: Clock) -> None:
    pulse = Pulse(monitor.descriptor)
    assert watch(monitor, clock, 30) == pytest.approx(30.0), "loading counts as busy"
    assert monitor.loading
    pulse.beat()
    assert watch(monitor, clock, 10) == pytest.approx(9.75)
    assert not monitor.loading
    pulse.beat()
    assert monitor.silent_s() == 0.0


def test_a_worker_that_rests_owes_no_pulse(monitor: PulseMonitor, clock: Clock) -> None:
    pulse = Pulse(monitor.descriptor)
    pulse.beat()
    pulse.rest()
    assert watch(monitor, clock, 10_000) == 0.0
    pulse.beat()
    assert watch(monitor, clock, 10) == pytest.approx(9.75)


def test_time_in_which_nobody_looked_does_not_count(monitor: PulseMonitor, clock: Clock) -> None:
    Pulse(monitor.descriptor).beat()
    monitor.silent_s()
    clock.now += 3600.0
    assert monitor.silent_s() <= 1.0


def test_it_goes_from_process_to_process(monitor: PulseMonitor, clock: Clock) -> None:
    environment = {**os.environ, PULSE: str(monitor.descriptor)}
    code = "from worker.health import Pulse; Pulse.of_environment().rest()"
    subprocess.run(
        [sys.executable, "-c", code], env=environment, pass_fds=[monitor.descriptor], check=True, timeout=240
    )
    assert watch(monitor, clock, 10) == 0.0
    Pulse.of_environment().beat()  # without a supervisor nobody is told


# The health check of a worker's container: quick, without torch, and red when no supervisor lives.


CHECK = [sys.executable, "-m", "worker.health"]
SUPERVISOR = """
from meshdeform.settings import Settings
from worker.health import sign_of_life
with sign_of_life(Settings()):
    print("here", flush=True)
    input()
"""


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "MESHDEFORM_DATA_DIR": str(folder)}
    return subprocess.run(CHECK, env=environment, capture_output=True, text=True, timeout=240)


def test_it_is_green_while_a_supervisor_lives(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    before = check(folder)
    assert (before.returncode, before.stderr) == (1, "no supervisor has run here\n")
    with sign_of_life(Settings(data_dir=folder)):
        with sign_of_life(Settings(data_dir=folder)):
            assert check(folder).returncode == 0
        assert check(folder).returncode == 0
    after = check(folder)
    assert (after.returncode, after.stderr) == (1, "the supervisor has ended\n")


def test_it_is_red_after_a_supervisor_was_killed(tmp_path: Path) -> None:
    environment = {**os.environ, "MESHDEFORM_DATA_DIR": str(tmp_path)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", SUPERVISOR], env=environment, **pipes) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == b"here\n"
        assert check(tmp_path).returncode == 0
        process.send_signal(signal.SIGKILL)
    assert check(tmp_path).returncode == 1


def test_a_folder_that_cannot_be_written_stops_no_supervisor(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    with sign_of_life(Settings(data_dir=tmp_path / "file" / "data")):
        pass
    assert caplog.text.count("health checks will not find this worker") == 1


def test_it_loads_nothing_heavy() -> None:
    code = "import sys, worker.health; print({'torch', 'numpy', 'sqlalchemy', 'redis'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "set()\n"
