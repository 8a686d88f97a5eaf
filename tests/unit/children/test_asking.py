"""Children: what they answer, that all tasks are there, and that they end with their parent."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from meshdeform.children import asking
from meshdeform.children.asking import ChildLostError, run_child
from meshdeform.children.protocol import OUT_OF_MEMORY, Bounds, answer_of, found_in
from meshdeform.children.tasks import TASKS, entry_point, loaded
from meshdeform.errors import AssetError, DependencyError, MeshdeformError, PartNotFoundError, UnauthorizedError
from meshdeform.requests.kind_folders import kind_table
from tests.cases import each_case
from tests.waiting import until

BOUNDS = Bounds(2**30, 60.0)
ASK = """
from meshdeform.children.asking import run_child
from meshdeform.children.protocol import Bounds
from meshdeform.children.tasks import TASKS
TASKS["sleep"] = "tests.sleeping_child:sleep"
run_child("sleep", {{"told": {told!r}}}, Bounds(2**30, 600.0, 2**20))
"""


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@each_case("name", sorted(TASKS | kind_table("child_tasks", "TASKS")))
def test_every_task_is_a_function(name: str) -> None:
    assert callable(loaded(entry_point(name)))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere only the parent stops a child")
def test_a_child_ends_with_its_parent(tmp_path: Path, repository: Path) -> None:
    told = tmp_path / "told"
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    with subprocess.Popen([sys.executable, "-c", ASK.format(told=str(told))], env=environment) as parent:
        until(lambda: told.exists() or parent.poll() is not None)
        child = int(told.read_text())
        parent.kill()
    until(lambda: not alive(child))


def test_what_is_given_may_be_long_and_what_is_printed_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TASKS, "echo", "tests.echoing_child:echo")
    monkeypatch.setattr(asking, "_POLL_S", 0.001)  # it is waited for before it can read
    given = {"text": "é\0\n" * 2**20}
    assert run_child("echo", given, BOUNDS) == given


@each_case(("do", "status"), [("exit", 7), ("memory", OUT_OF_MEMORY)])
def test_a_child_without_an_answer_is_lost(do: str, status: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TASKS, "echo", "tests.echoing_child:echo")
    with pytest.raises(ChildLostError) as raised:
        run_child("echo", {"do": do}, BOUNDS)
    assert (raised.value.status, raised.value.out_of_memory) == (status, do == "memory")


@each_case(
    ("error", "kind"),
    [
        (PartNotFoundError("There is no trunk.", advice="Name another.", parts=["legs"]), PartNotFoundError),
        (ModuleNotFoundError("No module", name="scipy"), DependencyError),
        (UnauthorizedError("Send a key."), AssetError),  # which no file makes
    ],
)
def test_an_error_comes_back_as_it_was(error: Exception, kind: type[MeshdeformError]) -> None:
    def fail() -> None:
        raise error

    with pytest.raises(kind) as raised:
        found_in(answer_of(fail))
    if isinstance(error, MeshdeformError):
        assert (raised.value.detail, raised.value.extra) == (error.detail, error.extra)
    else:
        assert raised.value.detail == "scipy is not installed."
