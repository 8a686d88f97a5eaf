"""Measure the CPU seconds of each test and fixture with all processes that they start.

    python -m pytest -p bench.cpu_of_tests tests/integration/test_release.py

A pytest plugin: it lists the most expensive at the end. Unlike the wall time of a test, its CPU time hardly depends on
what else the machine does. Processes that nobody waits for are lost when they end; a later test can then seem to cost
less than nothing. Several workers (`-n`) each measure their own tests:

    PYTEST_ADDOPTS="-p bench.cpu_of_tests" scripts/test
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

_TICKS = os.sysconf("SC_CLK_TCK")
_SHOWN = 40

_tests: Counter[str] = Counter()
_fixtures: Counter[str] = Counter()


def _descendants(pid: int) -> list[int]:
    found = []
    try:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            for child in (thread / "children").read_text().split():
                found += [int(child), *_descendants(int(child))]
    except OSError:  # it has ended meanwhile
        pass
    return found


def _cpu_s() -> float:
    """Return the seconds of this process, of those that live below it, and of those that these have waited for."""
    total = sum(os.times()[:4])
    for pid in _descendants(os.getpid()):
        try:
            # What follows the name, which may have spaces: state is the first, utime to cstime are 11 to 14.
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        total += sum(map(int, fields[11:15])) / _TICKS
    return total


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    """Measure a test with its fixtures."""
    before = _cpu_s()
    try:
        return (yield)
    finally:
        _tests[item.nodeid] += _cpu_s() - before  # type: ignore[assignment]


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[Any]) -> Generator[None, Any, Any]:
    """Measure a fixture, which is part of the first test that asks for it."""
    before = _cpu_s()
    try:
        return (yield)
    finally:
        _fixtures[f"{fixturedef.scope} {fixturedef.argname}"] += _cpu_s() - before  # type: ignore[assignment]


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Send what a worker has measured to the process that prints it."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["cpu_of_tests"] = [dict(_tests), dict(_fixtures)]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Add what a worker has measured."""
    tests, fixtures = getattr(node, "workeroutput", {}).get("cpu_of_tests", [{}, {}])
    _tests.update(tests)
    _fixtures.update(fixtures)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """List files, tests and fixtures, the most expensive first."""
    files: Counter[str] = Counter()
    for name, seconds in _tests.items():
        files[name.partition("::")[0]] += seconds
    for title, table in (("files", files), ("tests", _tests), ("fixtures", _fixtures)):
        terminalreporter.section(f"CPU seconds of {title}, {sum(table.values()):.0f} in all")
        for name, seconds in table.most_common(_SHOWN):
            terminalreporter.write_line(f"{seconds:7.1f}  {name}")
