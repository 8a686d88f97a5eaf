"""What a batch shall do: tables, folders, prompts, and rows whose keys and names stay."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.app import app
from meshdeform.cli.batch import _checker
from meshdeform.cli.batches import runners
from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import Entry, Row, combine, make_rows, read_prompts, read_table
from meshdeform.cli.batches.runners import RowOutcome
from meshdeform.cli.batches.session import Session, record_of
from meshdeform.cli.output import ProgressView
from meshdeform.errors import ParameterError, UnavailableError
from meshdeform.geometry.shapes import icosphere
from tests.cases import each_case
from tests.unit.assets.builders import unpack
from tests.unit.assets.test_replace import accessor


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two different assets."""
    (tmp_path / "a.glb").write_bytes(b"one")
    (tmp_path / "b.obj").write_bytes(b"two")
    (tmp_path / "notes.txt").write_text("no asset")
    return tmp_path


def rows_of(entries: list[Entry], **more: object) -> list[Row]:
    return make_rows(entries, **{"defaults": {}, **more})[0]  # type: ignore[arg-type]


def test_the_same_rows_in_every_format(folder: Path) -> None:
    (folder / "m.csv").write_text('asset,prompt,seed,name,morph\na.glb,"a vase, tall",3,,\nb.obj,2 dogs,,pets,yes\n')
    (folder / "m.tsv").write_text(
        "asset\tprompt\tseed\tname\tmorph\na.glb\ta vase, tall\t3\nb.obj\t2 dogs\t\tpets\tyes\n"
    )
    (folder / "m.jsonl").write_text(
        '{"asset": "a.glb", "prompt": "a vase, tall", "params": {"seed": 3}}\n\n'
        '{"asset": "b.obj", "prompt": "2 dogs", "output": "pets", "morph": true}\n'
    )
    tables = [read_table(folder / f"m.{suffix}") for suffix in ("csv", "tsv", "jsonl")]
    for table in tables:
        first, second = table
        assert (first.asset, first.prompt, first.params) == (folder / "a.glb", "a vase, tall", {"seed": 3})
        assert (second.prompt, second.name, second.morph, second.params) == ("2 dogs", "pets", True, {})
    assert len({tuple(row.key for row in rows_of(table)) for table in tables}) == 1


@each_case(
    ("name", "text", "said"),
    [
        ("m.csv", "prompt\na vase\n", "line 2: the asset is missing"),
        ("m.csv", "asset\n", "has no rows"),
        ("m.csv", "asset,prompt\na.glb,a vase,more\n", "more cells"),
        ("m.csv", "asset,morph\na.glb,perhaps\n", "not true or false"),
        ("m.jsonl", "[1]\n", "line 1, is not a JSON object"),
        ("m.jsonl", "{\n", "line 1, is not JSON"),
    ],
)
def test_a_broken_table_says_where(folder: Path, name: str, text: str, said: str) -> None:
    (folder / name).write_text(text)
    with pytest.raises(ParameterError, match=said):
        read_table(folder / name)


def test_a_folder_times_prompts_times_seeds(folder: Path) -> None:
    (folder / "prompts.txt").write_text("# shapes\n\na vase\n a mushroom \n")
    entries = combine(folder, read_prompts(folder / "prompts.txt"))
    rows = rows_of(entries, seeds=range(5, 8))
    made = {row.name: row.request.params.seed for row in rows[:4]}
    assert made == {"a-a-vase-seed5": 5, "a-a-vase-seed6": 6, "a-a-vase-seed7": 7, "a-a-mushroom-seed5": 5}
    assert len(rows) == len({row.key for row in rows}) == len({row.name for row in rows}) == 12
    with pytest.raises(ParameterError, match="not a manifest"):
        combine(folder, [])


def test_every_wrong_row_is_told_at_once(folder: Path) -> None:
    entries = [
        Entry("line 2", folder / "a.glb", params={"steps": 0}),
        Entry("line 3", folder / "gone.glb", "a vase"),
        Entry("line 4", folder / "a.glb", name="../out"),
        Entry("line 5", folder / "a.glb", params={"colour": "red"}),
        Entry("line 6", folder / "a.glb", "a vase"),
    ]
    with pytest.raises(ParameterError, match="4 of 5 rows") as told:
        rows_of(entries)
    assert [error["place"] for error in told.value.extra["errors"]] == ["line 2", "line 3", "line 4", "line 5"]


def test_a_key_is_what_decides_the_result_and_nothing_else(folder: Path) -> None:
    def key(**more: object) -> str:
        entry = Entry("x", folder / "a.glb", "a vase", **more)  # type: ignore[arg-type]
        return rows_of([entry])[0].key

    same = key()
    (folder / "c.glb").write_bytes(b"one")
    assert rows_of([Entry("elsewhere", folder / "c.glb", "a vase")])[0].key == same
    assert key(params={"seed": 0}) == same, "the default, written out"
    others = [key(params={"seed": 1}), key(morph=True), key(name="other"), key(target=folder / "b.obj")]
    assert len({same, *others}) == 5
    (folder / "a.glb").write_bytes(b"another one")
    assert key() != same


def test_rows_are_fitted_to_words_and_meshes_alike(folder: Path) -> None:
    entries = [
        Entry("1", folder / "a.glb", "a vase"),
        Entry("2", folder / "a.glb", target=folder / "b.obj"),
    ]
    rows = rows_of(entries, defaults={"guidance": {"kind": "exemplar", "strength": 0.9}})
    assert [row.request.params.flat()["strength"] for row in rows] == [0.9, 0.9]
    assert {row.request.params.kind.value for row in rows} == {"exemplar"}
    for row in rows:  # there are none
        assert {record_of(row, None, folder)[name] for name in ("preset", "model", "steps")} == {None}


def test_rows_here_name_their_kind_and_a_service_decides_it_itself(folder: Path) -> None:
    entries = [
        Entry("1", folder / "a.glb", "a vase"),
        Entry("2", folder / "a.glb", "a vase", params={"preset": "preview"}),
        Entry("3", folder / "a.glb", "a vase", params={"guidance": "sds"}),
    ]
    rows = rows_of(entries, check=_checker())
    assert [row.request.params.kind for row in rows] == ["exemplar", "sds", "sds"]
    sent = rows_of(entries)
    assert [row.request.params.model_dump(mode="json").get("guidance") for row in sent] == [None, None, {"kind": "sds"}]
    assert len({row.key for row in [*rows, *sent]}) == 5  # only the third is the same


def test_names_stay_when_others_join_and_never_meet(folder: Path) -> None:
    one = Entry("1", folder / "a.glb", "a vase", params={"steps": 10})
    (first,) = rows_of([one])
    other = Entry("0", folder / "a.glb", "A Vase", params={"steps": 20})
    again = rows_of([other, one], known_names={first.key: first.name})
    names = {row.key: row.name for row in again}
    assert names[first.key] == first.name
    assert len({name.casefold() for name in names.values()}) == 2
    rows, repeated = make_rows([one, one], defaults={})
    assert len(rows) == 1
    assert repeated == ["1"]


def test_what_was_written_is_known_again(tmp_path: Path) -> None:
    with Ledger(tmp_path / "out") as ledger:
        identity = ledger.batch_id
        for code in ("x", "y"):
            ledger.append("failed", "k1", "vase", error={"code": code})
        ledger.append("done", "k2", "dog", seconds=1.5)
    with Ledger(tmp_path / "out") as again:
        assert (again.batch_id, again.tries) == (identity, {"k1": 2})
        assert (again.last["k1"]["error"], again.last["k2"]["event"]) == ({"code": "y"}, "done")
        assert again.known_names() == {"k1": "vase", "k2": "dog"}


@each_case("keep", [1, 20, 60])
def test_half_a_line_at_the_end_is_cut_off(tmp_path: Path, keep: int) -> None:
    folder = tmp_path / str(keep)
    with Ledger(folder) as ledger:
        ledger.append("done", "k1", "vase")
        whole = ledger.path.read_bytes()
        ledger.append("done", "k2", "dog")
        torn = ledger.path.read_bytes()[: len(whole) + keep]
    ledger.path.write_bytes(torn)
    with Ledger(folder) as again:
        assert set(again.last) == {"k1"}
        again.append("done", "k3", "cat")
    with Ledger(folder) as once_more:
        assert set(once_more.last) == {"k1", "k3"}


def test_a_ledger_is_one_processs_own_and_says_what_is_wrong(tmp_path: Path) -> None:
    with Ledger(tmp_path) as ledger:
        ledger.append("done", "k1", "vase")
        with pytest.raises(UnavailableError, match="Another `meshdeform batch`"):
            Ledger(tmp_path)
    with ledger.path.open("ab") as file:
        file.write(b"nonsense\n")
    with pytest.raises(ParameterError, match="line 3"):
        Ledger(tmp_path)
    with pytest.raises(UnavailableError, match="cannot be written"):
        Ledger(ledger.path / "out")


HEIGHTS = {"a mushroom": 2.0, "a vase": 3.0, "a rocket": None}


class FakeRunner:
    """Stretches an asset to the height of its prompt, or fails; breaks down at the row of a name."""

    breaks_at = ""

    def __init__(self, folder: Path, _share: object = None) -> None:
        self._folder, self.done = folder, list[str]()

    def do(self, row: Row, _progress: ProgressView) -> RowOutcome:
        path = row.path(self._folder, "result.glb")
        path.parent.mkdir(exist_ok=True)
        if row.name == self.breaks_at:
            path.write_bytes(b"half")
            raise UnavailableError("The disk is full.")
        height = HEIGHTS[row.request.prompt]
        if height is None:
            return RowOutcome("failed", 1.0, error={"code": "numerical_error", "detail": "", "advice": ""})
        source = load_asset(row.asset.read_bytes())
        path.write_bytes(source.replace(source.surface.positions * [1, height, 1]))
        for name in ("report.json", "preview.png"):
            row.path(self._folder, name).write_text(row.name)
        self.done.append(row.name)
        return RowOutcome("succeeded", 1.0)

    def close(self) -> None:
        """Close nothing."""


BALL = icosphere(1)


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    path = tmp_path / "ball.glb"
    path.write_bytes(build_glb(BALL.verts, BALL.faces))
    return path


def test_the_results_of_an_asset_are_the_targets_of_one_file(
    ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runners, "LocalRunner", FakeRunner)
    prompts = [word for prompt in HEIGHTS for word in ("--prompt", prompt)]
    command = ["batch", str(ball), *prompts, "-o", str(tmp_path / "out"), "--as-morph-targets"]
    done = CliRunner().invoke(app, [*command, "--json"])
    assert done.exit_code == 8, done.output  # one row failed
    made = json.loads(done.stdout.splitlines()[-1])["files"]["ball.targets.glb"]
    root, binary, _ = unpack(Path(made).read_bytes())
    (mesh,) = root["meshes"]
    assert mesh["extras"]["targetNames"] == ["ball-a-mushroom", "ball-a-vase"]
    assert mesh["weights"] == [0.0, 0.0]
    assert "animations" not in root
    for target, height in zip(mesh["primitives"][0]["targets"], (2.0, 3.0), strict=True):
        moved = accessor(root, binary, target["POSITION"])
        np.testing.assert_allclose(moved, BALL.verts * [0, height - 1, 0], atol=1e-6)


def test_an_interrupted_batch_resumes_under_the_same_names(
    ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, runner, names = tmp_path / "out", FakeRunner(tmp_path / "out"), list[str]()

    def go() -> None:
        with Ledger(out) as ledger:
            rows, _ = make_rows(
                [Entry("1", ball, "a vase")], defaults={}, seeds=(3, 4, 5), known_names=ledger.known_names()
            )
            names[:] = [row.name for row in rows]
            Session(ledger, as_json=False, quiet=True).run(rows, runner, 1, retry_failed=False)

    monkeypatch.setattr(FakeRunner, "breaks_at", "ball-a-vase-seed4")
    with pytest.raises(UnavailableError):
        go()
    monkeypatch.undo()
    go()
    assert names == runner.done == [f"ball-a-vase-seed{n}" for n in (3, 4, 5)]
    assert all(load_asset((out / name / "result.glb").read_bytes()) for name in names)
