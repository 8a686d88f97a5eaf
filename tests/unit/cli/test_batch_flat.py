"""`batch --flat`: results in one folder, under names that say what they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import Entry, Row, make_rows
from meshdeform.cli.batches.runners import RowOutcome
from meshdeform.cli.batches.session import Session
from meshdeform.cli.output import ProgressView
from meshdeform.errors import ParameterError, UnavailableError


class FakeRunner:
    """Writes the name of a row as its results; fails on the rows that it was given."""

    def __init__(self, folder: Path, breaks_on: str = "") -> None:
        self.folder, self.breaks_on, self.done = folder, breaks_on, list[str]()

    def do(self, row: Row, _progress: ProgressView) -> RowOutcome:
        (self.folder / row.name).mkdir(exist_ok=True)
        for artifact in ("result.glb", "report.json", "preview.png"):
            (self.folder / row.name / artifact).write_text(row.name)
        if row.name == self.breaks_on:
            raise UnavailableError("The disk is full.")
        self.done.append(row.name)
        return RowOutcome("succeeded", 1.0)

    def close(self) -> None:
        """Close nothing."""


@pytest.fixture
def duck(tmp_path: Path) -> Path:
    path = tmp_path / "duck.glb"
    path.write_bytes(b"one")
    return path


def flat_rows(session: Session, *entries: Entry, seeds: tuple[int, ...] = ()) -> list[Row]:
    occupied = [path.name for path in session.folder.iterdir()]
    known = session.ledger.known_names()
    return make_rows(entries, defaults={}, seeds=seeds, flat=True, occupied=occupied, known_names=known)[0]


def files(out: Path) -> set[str]:
    return {path.name for path in out.iterdir() if path.suffix in {".glb", ".json", ".png"}} - {
        "summary.json",
        "sheet.png",
    }


def test_names_say_what_the_files_are_and_never_meet(duck: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.morph.glb").write_text("kept")
    vase = Entry("1", duck, "a tall vase", params={"seed": 7})
    entries = [
        vase,
        Entry("2", duck, "A tall vase", params={"seed": 7, "steps": 9}),
        Entry("3", duck, "a dog", name="mine"),
        Entry("4", duck, "a dog", name="other"),
        Entry("5", duck, "a dog", name="other.report"),
    ]
    with Ledger(out, flat=True) as ledger:
        session = Session(ledger, as_json=False, quiet=True)
        rows = flat_rows(session, *entries)
        session.run(rows, FakeRunner(out), 1, retry_failed=False)
        session.finish(rows)
    names = [row.name for row in rows]
    assert names[0] == "duck-a-tall-vase-seed7"
    assert names[1] == f"duck-A-tall-vase-seed7-{rows[1].key[:8]}"
    assert names[2] == f"mine-{rows[2].key[:8]}"
    assert (out / "mine.morph.glb").read_text() == "kept"
    assert files(out) == {"mine.morph.glb"} | {
        f"{n}{e}" for n in names for e in (".glb", ".report.json", ".preview.png")
    }
    assert all((out / f"{name}.glb").read_text() == name for name in names)
    assert not any(path.is_dir() for path in out.iterdir())
    assert str(out / "duck-a-tall-vase-seed7.glb") in (out / "summary.csv").read_text()


def test_an_interrupted_batch_resumes_under_the_same_names(duck: Path, tmp_path: Path) -> None:
    out, entry = tmp_path / "out", Entry("1", duck, "a vase")
    seeds = (3, 4, 5)
    with Ledger(out, flat=True) as ledger:
        session = Session(ledger, as_json=False, quiet=True)
        rows = flat_rows(session, entry, seeds=seeds)
        with pytest.raises(UnavailableError):
            session.run(rows, FakeRunner(out, "duck-a-vase-seed4"), 1, retry_failed=False)
    # As if it had died while it moved the files of the second row.
    (out / "duck-a-vase-seed4" / "report.json").replace(out / "duck-a-vase-seed4.report.json")
    with Ledger(out, flat=True) as ledger:
        session = Session(ledger, as_json=False, quiet=True)
        again, runner = flat_rows(session, entry, seeds=seeds), FakeRunner(out)
        session.run(again, runner, 1, retry_failed=False)
    assert [row.name for row in again] == [f"duck-a-vase-seed{n}" for n in seeds]
    assert runner.done == ["duck-a-vase-seed4", "duck-a-vase-seed5"]
    assert files(out) == {f"duck-a-vase-seed{n}{e}" for n in seeds for e in (".glb", ".report.json", ".preview.png")}


def test_the_layout_of_a_batch_does_not_change(tmp_path: Path) -> None:
    with Ledger(tmp_path):
        pass
    with pytest.raises(ParameterError, match="without --flat"):
        Ledger(tmp_path, flat=True)
