"""How many threads are used where none are set, and how they wait."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from meshdeform.runs.devices import use_threads
from meshdeform.support.threads import default_threads, in_ranges, limit_waiting, side_by_side
from tests.cases import each_case


@pytest.fixture
def eight_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)


@pytest.mark.usefixtures("eight_cores")
@each_case(
    ("limit", "chosen", "threads"),
    [
        ("max 100000", "", 8),
        ("200000 100000", "", 2),
        ("250000 100000", "", 3),
        ("50000 100000", "", 1),
        ("6400000 100000", "", 8),
        ("", "", 8),
        *(("", chosen, threads) for chosen, threads in (("3", 3), ("16", 16), ("4,2", 4), ("0", 8), ("many", 8))),
    ],
)
def test_a_container_uses_no_more_threads_than_its_cpu_limit_unless_omp_num_threads_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, chosen: str, threads: int
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", chosen)
    (tmp_path / "cpu.max").write_text(f"{limit}\n")
    assert default_threads(tmp_path) == threads


@pytest.mark.usefixtures("eight_cores")
def test_the_limits_of_control_groups_version_1_are_read(tmp_path: Path) -> None:
    (tmp_path / "cpu").mkdir()
    (tmp_path / "cpu/cpu.cfs_period_us").write_text("100000\n")
    for quota, threads in ((-1, 8), (150_000, 2)):
        (tmp_path / "cpu/cpu.cfs_quota_us").write_text(f"{quota}\n")
        assert default_threads(tmp_path) == threads


def test_the_setting_comes_before_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    torch = SimpleNamespace(set_num_threads=asked.append)
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setattr("meshdeform.support.threads._chosen", 0)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert [use_threads(2), use_threads(0)] == asked == [2, 3]


def test_spinning_is_limited_unless_the_environment_says_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "environ", {})
    limit_waiting()
    assert os.environ == {"GOMP_SPINCOUNT": "10000", "OPENBLAS_NUM_THREADS": "1"}
    for chosen in (
        {"GOMP_SPINCOUNT": "7", "OPENBLAS_NUM_THREADS": "2"},
        {"OMP_WAIT_POLICY": "active", "OPENBLAS_NUM_THREADS": "8"},
    ):
        monkeypatch.setattr(os, "environ", dict(chosen))
        limit_waiting()
        assert os.environ == chosen


@each_case("module", ["meshdeform.cli.app", "worker.__main__"])
def test_programs_limit_it_before_anything_imports_torch(module: str) -> None:
    # What main() calls next stops it; the limit must be there by then, and torch must not.
    program = f"""
import os, sys
import {module} as program
def stop(*args, **kwargs):
    assert 'torch' not in sys.modules
    print(os.environ['GOMP_SPINCOUNT'])
    sys.exit()
for name in ('app', 'Settings'):
    if hasattr(program, name):
        setattr(program, name, stop)
program.main()
"""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("GOMP_", "OMP_"))}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "10000\n"


def test_ranges_cover_everything_once_and_all_of_them_end(monkeypatch: pytest.MonkeyPatch) -> None:
    for count in range(1, 7):
        for threads in range(1, 5):
            monkeypatch.setattr("meshdeform.support.threads._chosen", threads)
            ranges = in_ranges(lambda begin, end: (begin, end, threading.get_ident()), count)
            assert [number for begin, end, _ in ranges for number in range(begin, end)] == list(range(count))
            assert len(ranges) == min(count, threads)
            assert ranges[0][2] == threading.get_ident()
    # Work that is shared already is not shared again: its threads would wait for themselves.
    nested = in_ranges(lambda begin, end: in_ranges(lambda *bounds: bounds, end - begin), 6)
    assert nested == [[(0, 1)], [(0, 2)], [(0, 1)], [(0, 2)]]
    # An error is raised once no range is being worked on.
    failed, finished = threading.Event(), threading.Event()

    def work(begin: int, _: int) -> None:
        if begin == 0:
            failed.set()
            raise ValueError("the first range")
        assert failed.wait(10)
        finished.set()

    with pytest.raises(ValueError, match="the first range"):
        in_ranges(work, 2)
    assert finished.is_set()


def test_works_meet_if_there_are_two_threads_and_take_turns_if_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    meeting = threading.Barrier(2, timeout=240)
    monkeypatch.setattr("meshdeform.support.threads._chosen", 2)
    assert sorted(side_by_side(meeting.wait, meeting.wait)) == [0, 1]
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda: 1, lambda: 1 // 0)
    monkeypatch.setattr("meshdeform.support.threads._chosen", 1)
    assert side_by_side(threading.get_ident, threading.get_ident) == [threading.get_ident()] * 2
