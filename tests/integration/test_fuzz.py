"""Damaged files by the thousand: an asset or a clear refusal, whatever they hold; `bench/fuzz.py` does more of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench import fuzz
from meshdeform.assets import check_asset_subprocess
from meshdeform.errors import MeshdeformError

SEED = 20_260_101


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("mutants", [300, pytest.param(20_000, marks=pytest.mark.long)])
def test_no_mutant_crashes_the_reader(mutants: int) -> None:
    found = fuzz.run(SEED, mutants=mutants)
    assert found["defects"] == []
    assert sum(found["outcomes"].values()) == found["mutants"] == mutants
    # A fuzz that is refused at the first byte, or changes nothing that matters, finds nothing.
    assert found["outcomes"]["accepted"] > mutants // 20
    assert {"asset_invalid", "asset_truncated", "asset_format", "asset_no_triangles"} <= found["outcomes"].keys()


def test_a_mutant_is_the_same_wherever_it_is_made() -> None:
    assert [fuzz.mutant(5, number) for number in range(40)] == [fuzz.mutant(5, number) for number in range(40)]
    assert len({fuzz.mutant(5, number)[1] for number in range(40)}) > 30


@pytest.mark.parametrize("mutants", [4, pytest.param(25, marks=pytest.mark.long)])
def test_the_check_says_what_the_fuzz_says(mutants: int, tmp_path: Path) -> None:
    path = tmp_path / "upload"
    for number in range(mutants):
        name, data = fuzz.mutant(SEED, number)
        path.write_bytes(data)
        try:
            check_asset_subprocess(path, name)
            code = "accepted"
        except MeshdeformError as error:
            code = error.code if error.status < 500 else f"{error.status}: {error}"
        assert code == fuzz.outcome(name, data)


@pytest.mark.parametrize(
    ("instead", "says"),
    [("raise KeyError('a defect')", "a defect"), ("os.kill(os.getpid(), 11)", "ended with -11")],
)
def test_a_defect_is_found_and_the_fuzz_goes_on(
    instead: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "if '--child' in sys.argv:\n"
        "    import meshdeform.assets.inspect as inspect\n"
        "    real, calls = inspect.inspect_asset, []\n"
        "    def broken(*a):\n"
        "        calls.append(1)\n"
        f"        if len(calls) == 2: {instead}\n"
        "        return real(*a)\n"
        "    inspect.inspect_asset = broken\n"
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{fuzz.ROOT}")
    found = fuzz.run(SEED, mutants=4)
    assert found["mutants"] == 4
    assert len(found["defects"]) >= 1
    assert all(says in what for _, what in found["defects"])
