"""Processes that are kept for questions: whose they are, what they know, and how they end."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from meshdeform.children import warm
from meshdeform.children.asking import ChildLostError
from meshdeform.children.protocol import StoppedError
from meshdeform.children.tasks import TASKS
from meshdeform.children.warm import Asked, WarmProcesses
from meshdeform.errors import PartNotFoundError
from tests.cases import each_case
from tests.waiting import until

TIMEOUT_S = 60.0


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> Iterator[WarmProcesses]:
    monkeypatch.setenv("MESHDEFORM_DATABASE_URL", "postgresql://secret")
    monkeypatch.setitem(TASKS, "warm", "tests.warm_answers:answer")
    kept = WarmProcesses("warm", most=2, idle_s=600.0)
    yield kept
    kept.close()


def ask(processes: WarmProcesses, owner: str = "ann", do: str = "tell", asked: Asked | None = None, **more: Any) -> Any:
    return processes.ask(owner, {"do": do, **more}, more.pop("timeout_s", TIMEOUT_S), asked or Asked())


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_an_owner_has_a_process_that_remembers_and_no_other_owner_reaches(processes: WarmProcesses) -> None:
    first, other = ask(processes, name="a"), ask(processes, "ben", name="b")
    again = ask(processes, name="c")
    assert first["pid"] == again["pid"] != other["pid"]
    assert (again["seen"], other["seen"]) == (["a", "c"], ["b"])


def test_it_has_no_secrets_and_gives_way_to_jobs(processes: WarmProcesses) -> None:
    told = ask(processes)
    assert not any(name.startswith("MESHDEFORM") for name in told["environment"])
    assert told["nice"] == min(19, os.nice(0) + 10)


def test_an_error_comes_back_as_it_was(processes: WarmProcesses) -> None:
    with pytest.raises(PartNotFoundError) as raised:
        ask(processes, do="refuse")
    error = raised.value
    assert (error.detail, error.extra) == ("There is no trunk.", {"parts": ["legs"]})


def test_a_question_that_is_taken_back_ends_and_its_process_knows_what_it_knew(processes: WarmProcesses) -> None:
    pid = ask(processes, name="a")["pid"]
    asked = Asked()
    threading.Timer(0.05, asked.stop).start()
    with pytest.raises(StoppedError):
        ask(processes, do="wait", asked=asked)
    assert ask(processes)["pid"] == pid


def test_who_has_gone_is_not_waited_with_and_the_next_question_has_its_own_answer(
    processes: WarmProcesses, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warm, "_GRACE_S", 3600.0)  # here, and not in the process
    pid, asked = ask(processes)["pid"], Asked()
    asked.stop()
    for name in ("a", "b", "c"):
        with pytest.raises(StoppedError):  # at once, though it does not notice
            ask(processes, do="linger", name=name, asked=asked)
    told = ask(processes, name="d")
    # The next ones may be begun before the process hears that nobody waits for them.
    assert (told["pid"], told["seen"][:2], told["seen"][-1]) == (pid, ["", "a"], "d")


@each_case("grace_s", [0.1, 3600.0])
def test_one_that_does_not_notice_is_ended(
    processes: WarmProcesses, monkeypatch: pytest.MonkeyPatch, grace_s: float
) -> None:
    """By whoever asks next, or by itself, whichever is sooner."""
    monkeypatch.setattr(warm, "_GRACE_S", grace_s)
    pid, asked = ask(processes)["pid"], Asked()
    asked.stop()
    with pytest.raises(StoppedError):
        ask(processes, do="hang", asked=asked)
    assert ask(processes)["pid"] != pid
    until(lambda: not alive(pid))


def test_one_that_takes_too_long_is_stopped_and_knows_what_it_knew(processes: WarmProcesses) -> None:
    pid = ask(processes)["pid"]
    with pytest.raises(TimeoutError):
        processes.ask("ann", {"do": "wait"}, 0.1, Asked())
    assert ask(processes)["pid"] == pid


def test_one_that_takes_too_long_and_does_not_stop_is_ended(
    processes: WarmProcesses, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warm, "_GRACE_S", 0.1)
    pid = ask(processes)["pid"]
    with pytest.raises(TimeoutError):
        processes.ask("ann", {"do": "hang"}, 0.1, Asked())
    until(lambda: not alive(pid))


def test_one_that_dies_takes_nothing_with_it(processes: WarmProcesses) -> None:
    other = ask(processes, "ben")["pid"]
    with pytest.raises(ChildLostError):
        ask(processes, do="die")
    assert ask(processes)["seen"] == [""]
    assert ask(processes, "ben")["pid"] == other


def test_the_one_that_was_asked_least_recently_goes(processes: WarmProcesses) -> None:
    pids = {owner: ask(processes, owner)["pid"] for owner in ("ann", "ben", "ann", "cat")}
    until(lambda: not alive(pids["ben"]))
    assert ask(processes, "ann")["pid"] == pids["ann"]


def test_all_end_when_nobody_asks_and_when_it_is_closed(processes: WarmProcesses) -> None:
    pid = ask(processes)["pid"]
    processes.tidy()
    assert ask(processes)["pid"] == pid
    processes._idle_s = -1.0
    processes.tidy()
    until(lambda: not alive(pid))
    assert processes._first is None
    pid = ask(processes)["pid"]
    processes.close()
    until(lambda: not alive(pid))
