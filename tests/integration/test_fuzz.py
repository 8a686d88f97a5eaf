"""Damaged files by the thousand: an asset or a clear refusal, whatever they hold; `bench/fuzz.py` does more of them."""

from __future__ import annotations

from bench import fuzz

SEED = 20_260_101


def test_no_mutant_crashes_the_reader() -> None:
    mutants = 300
    found = fuzz.run(SEED, mutants=mutants)
    assert found["defects"] == []
    assert sum(found["outcomes"].values()) == found["mutants"] == mutants
    # A fuzz that is refused at the first byte, or changes nothing that matters, finds nothing.
    assert found["outcomes"]["accepted"] > mutants // 20
    assert {"asset_invalid", "asset_truncated", "asset_format", "asset_no_triangles"} <= found["outcomes"].keys()
