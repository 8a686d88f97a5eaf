"""List a run of the benchmark: its deformations, parameters and number of steps.

Loads no model, so a suite for another machine can be listed on this one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from meshdeform.requests.choices import is_builtin
from training.evaluation.plan import Plan
from training.evaluation.retrieval import NO_JUDGE

__all__ = ["listing", "outline"]


def outline(plan: Plan, *, limit: int | None = None) -> dict[str, Any]:
    """Return the plan as a document.

    Returns
    -------
    `suite`, `folder`, `model`, `device`, `judge`, `clip`, `ablation`, `checkpoints` (the steps after which a shape is
    judged), `params`, `items` (each with `source`, `prompt` and `seed`), `deformations`, `steps_in_all`, and
    `warnings` about what the run itself would refuse.
    """
    items = plan.suite.items(limit)
    warnings = []
    if not is_builtin(plan.params.model) and plan.judge != NO_JUDGE and plan.suite.name == "paper":
        warnings.append("The builtin judge does not know these prompts: give --judge none, and --clip FOLDER.")
    if is_builtin(plan.params.model) and plan.suite.name == "paper":
        warnings.append("The builtin prior does not know these prompts: give --prior sd --model CHECKPOINT.")
    return {
        "suite": plan.suite.name,
        "folder": str(plan.folder),
        "model": plan.params.model,
        "device": plan.device,
        "judge": plan.judge,
        "clip": plan.clip or None,
        "ablation": plan.ablation,
        "checkpoints": list(plan.steps),
        "params": plan.params.model_dump(mode="json", exclude={"seed", "model", "checkpoint_every_steps"}),
        "items": [{"source": item.source, "prompt": item.prompt, "seed": item.seed} for item in items],
        "deformations": len(items),
        "steps_in_all": len(items) * plan.params.steps,
        "warnings": warnings,
    }


def listing(plan: Plan, *, limit: int | None = None) -> str:
    """Return the plan as text: a line for each deformation, then the parameters and the totals."""
    facts = outline(plan, limit=limit)
    lines = [f"{number:4d}  {Path(item['source']).stem:<10} {item['prompt']}  (seed {item['seed']})"
             for number, item in enumerate(facts["items"], 1)]  # fmt: skip
    parameters = ", ".join(f"{name}={value}" for name, value in facts["params"].items() if value != "")
    lines += [
        "",
        f"model     {facts['model']} on {facts['device']}; judge {facts['judge']}; CLIP {facts['clip'] or 'none'}",
        f"params    {parameters}",
        *([f"ablation  {facts['ablation']}"] if facts["ablation"] else []),
        f"judged    after {', '.join(str(step) for step in facts['checkpoints'])} steps",
        f"in all    {facts['deformations']} deformations, {facts['steps_in_all']:,} steps, into {facts['folder']}",
        *(f"warning   {warning}" for warning in facts["warnings"]),
    ]
    return "\n".join(lines) + "\n"
