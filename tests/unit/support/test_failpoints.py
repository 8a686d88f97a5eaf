"""Failpoints strike where and when they are told to, and nothing else is called one."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from meshdeform.support.failpoints import FAILPOINTS, _parse
from tests.cases import each_case

TWICE = (
    "from meshdeform.support.failpoints import failpoint;"
    " failpoint('worker.step'); failpoint('worker.step'); print('alive')"
)


def run(points: str, code: str = TWICE) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "MESHDEFORM_FAILPOINTS": points}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=240)


def test_the_list_and_the_calls_agree(repository: Path) -> None:
    sources = [path for top in ("meshdeform", "service", "worker") for path in (repository / top).rglob("*.py")]
    calls = [name for path in sources for name in re.findall(r"failpoint\(\"([^\"]+)\"\)", path.read_text())]
    assert sorted(calls) == sorted(FAILPOINTS), "each name is called at one place, and each call has a name of the list"
    assert len(set(FAILPOINTS)) == len(FAILPOINTS)


def test_a_file_keeps_it_from_striking_again(tmp_path: Path) -> None:
    points = f"worker.step=kill@2;{tmp_path / 'died'}"
    assert run(points).returncode == -signal.SIGKILL
    assert (tmp_path / "died").exists()
    assert run(points).stdout == "alive\n"


@each_case("text", ["worker.step", "worker.stepp=kill", "worker.step=die", "worker.step=pause", "worker.step=kill:f"])
def test_what_is_no_failpoint_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is not a failpoint"):
        _parse(text)
