"""A second prompt for an asset waits for no question about it."""

from __future__ import annotations

from pathlib import Path

from meshdeform.runs.last_assets import Recent
from tests.fakes import FakePrior
from tests.unit.runs.jobs import finished, started


def test_another_prompt_for_the_last_asset_asks_nothing_again_and_changes_no_byte(repository: Path) -> None:
    asset = (repository / "examples/cube.glb").read_bytes()
    priors = [FakePrior() for _ in range(4)]
    prompts = ["a camel", "a horse", "a camel", "a camel"]
    seeds = [0, 0, 0, 1]
    runs = [
        started(asset, prompt, prior=prior, seed=seed, steps=2 + number, orientation="auto", source_noun="vase")
        for number, (prompt, prior, seed) in enumerate(zip(prompts, priors, seeds, strict=True))
    ]
    # Another seed is another question.
    assert [bool(prior.timesteps) for prior in priors] == [True, False, False, True]
    again = started(asset, "a camel", prior=FakePrior(), steps=2, orientation="auto", source_noun="vase")
    (result, report), (first_result, first_report) = finished(again), finished(runs[0])
    assert (result, report["orientation"]) == (first_result, first_report["orientation"])


def test_what_was_not_used_for_long_is_forgotten() -> None:
    recent: Recent[int] = Recent()
    for number in range(64):
        recent.put(str(number), number)
    assert recent.get("0") == 0
    recent.put("64", 64)
    assert (recent.get("0"), recent.get("1"), recent.get("64")) == (0, None, 64)
