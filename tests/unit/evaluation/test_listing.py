"""What a run would do, said before it does it."""

from __future__ import annotations

from pathlib import Path

from meshdeform.requests.document import DeformParams, resolve
from meshdeform.requests.groups import grouped
from tests.cases import each_case
from training.evaluation.listing import listing, outline
from training.evaluation.plan import Plan
from training.evaluation.suite import PAPER_PROMPTS, find_suite


def plan(suite: str, model: str, *, judge: str = "none", **params: object) -> Plan:
    chosen = find_suite(suite)
    resolved = resolve(DeformParams.model_validate(grouped({"preset": chosen.preset, "model": model, **params})))
    return Plan(chosen, resolved, (100, resolved.steps), Path("somewhere"), judge=judge)


def test_the_papers_suite_is_listed_whole_with_the_papers_parameters() -> None:
    found = outline(plan("paper", "some/checkpoint", timestep_min=0.5))
    assert found["deformations"] == 48 == len(found["items"])
    assert found["steps_in_all"] == 48 * 5000
    assert {item["source"] for item in found["items"]} == {"sphere", "vase", "armchair", "quadruped"}
    assert set(PAPER_PROMPTS) < {item["prompt"] for item in found["items"]}
    assert found["params"]["guidance_scale"] == 100
    assert found["params"]["timestep_min"] == 0.5
    assert (found["model"], found["checkpoints"], found["warnings"]) == ("some/checkpoint", [100, 5000], [])


@each_case(("model", "said"), [("some/checkpoint", "--judge none"), ("builtin", "--prior sd")])
def test_what_the_run_would_refuse_is_said(model: str, said: str) -> None:
    assert said in listing(plan("paper", model, judge="builtin"))
