"""What a batch shall do: tables, folders, prompts, and rows whose keys and names stay."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.cli.batches.rows import Entry, Row, combine, make_rows, read_prompts, read_table
from meshdeform.errors import ParameterError
from tests.cases import each_case


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
    assert [row.name for row in rows[:4]] == [
        "a-a-vase-seed5",
        "a-a-vase-seed6",
        "a-a-vase-seed7",
        "a-a-mushroom-seed5",
    ]
    assert [row.request.params.seed for row in rows[:3]] == [5, 6, 7]
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
