"""The ledger of a batch: it survives a torn line, is one process's own, and says what is damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.cli.batches.ledger import Ledger
from meshdeform.errors import ParameterError, UnavailableError
from tests.cases import each_case


def test_what_was_written_is_known_again(tmp_path: Path) -> None:
    with Ledger(tmp_path / "out") as ledger:
        identity = ledger.batch_id
        ledger.append("failed", "k1", "vase", error={"code": "x"})
        ledger.append("failed", "k1", "vase", error={"code": "y"})
        ledger.append("done", "k2", "dog", seconds=1.5)
    with Ledger(tmp_path / "out") as again:
        assert again.batch_id == identity
        assert again.tries == {"k1": 2}
        assert again.last["k1"]["error"] == {"code": "y"}
        assert again.last["k2"]["event"] == "done"
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


def test_a_folder_is_one_processs_own(tmp_path: Path) -> None:
    with Ledger(tmp_path), pytest.raises(UnavailableError, match="Another `meshdeform batch`"):
        Ledger(tmp_path)
    with Ledger(tmp_path):
        pass


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    with Ledger(tmp_path) as ledger:
        ledger.append("done", "k1", "vase")
    with ledger.path.open("ab") as file:
        file.write(b"nonsense\n")
    with pytest.raises(ParameterError, match="line 3"):
        Ledger(tmp_path)


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"in the way")
    with pytest.raises(UnavailableError, match="cannot be written"):
        Ledger(tmp_path / "file" / "out")
