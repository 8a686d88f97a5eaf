"""Damaged files by the thousand: an asset or a clear refusal, whatever they hold; `bench/fuzz.py` does more of them."""

from __future__ import annotations

import pytest

from bench import fuzz

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
