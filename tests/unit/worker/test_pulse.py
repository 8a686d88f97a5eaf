"""The supervisor sees whether its worker moves, and is not deceived by its own sleep."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from worker.health import PULSE, Pulse, PulseMonitor


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
    subprocess.run([sys.executable, "-c", code], env=environment, pass_fds=[monitor.descriptor], check=True, timeout=60)
    assert watch(monitor, clock, 10) == 0.0


def test_without_a_supervisor_nobody_is_told() -> None:
    assert PULSE not in os.environ
    Pulse.of_environment().beat()
