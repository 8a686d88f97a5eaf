"""Run a benchmark: check that the folder belongs to it, evaluate the remaining items, and write the report.

::

    manifest.json   everything that affects the results
    sources/        the source meshes, and the corners of their faces in their textures
    items/          one folder for each deformation (`evaluator`)
    results.json    every record, the summaries, and the manifest
    table.md        the summaries as tables
    sheet.png       the contact sheet

A run can be interrupted at any time, by Ctrl-C or a power failure, and the same command continues it.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from meshdeform.errors import MeshdeformError, ParameterError, PromptError, VocabularyError, WorkerLostError
from meshdeform.requests.choices import is_builtin
from meshdeform.support.files import write_files
from training.evaluation.clip_judge import refuse_the_guides_own
from training.evaluation.delivered import DeliveredEvaluator
from training.evaluation.evaluator import Evaluator, failed_record, read_record, source_path, texels_path
from training.evaluation.mesh_file import write_ply, write_texels
from training.evaluation.plan import Plan, check_manifest, manifest, read_manifest, write_manifest
from training.evaluation.pool import each
from training.evaluation.report import write_report
from training.evaluation.retrieval import NO_JUDGE
from training.evaluation.sources import source_mesh, source_texels
from training.evaluation.suite import Item

Work = Callable[[Item], dict[str, Any]]
Say = Callable[[str], None]


def default_jobs(plan: Plan) -> int:
    """Return the number of processes: all cores for the builtin prior on the CPU, otherwise one."""
    if not is_builtin(plan.params.model) or plan.device != "cpu":
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run(plan: Plan, *, jobs: int, limit: int | None = None, say: Say = print) -> dict[str, Any]:
    """Evaluate the remaining items of a run, and write its report.

    Parameters
    ----------
    plan : Plan
    jobs : int
        Number of processes.
    limit : int, optional
        Maximum number of items, from the first.
    say : callable
        Receives a line for each finished item.

    Returns
    -------
    The document in `results.json`.

    Raises
    ------
    MeshdeformError
        The folder belongs to another run, or a model is not available or does not support the prompts.
    """
    evaluator = _evaluator(plan)
    assert evaluator.prior is not None
    # What `auto` is here, so that another machine does not go on in another precision.
    plan = replace(plan, dtype=str(evaluator.prior.dtype).removeprefix("torch."))
    if plan.clip and not is_builtin(plan.params.model):
        refuse_the_guides_own(Path(plan.clip), plan.params.model, plan.revision)
    for prompt in plan.suite.prompts:
        evaluator.prior.encode_texts(prompt, plan.params.negative_prompt)
    expected = manifest(plan, dict(evaluator.prior.identity), *_judge_identities(plan, evaluator))
    stored = read_manifest(plan.folder)
    if stored is not None:
        check_manifest(plan.folder, stored, expected)
    _prepare(plan, expected)
    items = plan.suite.items(limit)
    left = [item for item in items if (record := read_record(plan.folder, item)) is None or record["failed"]]
    if len(items) > len(left):
        say(f"{len(items) - len(left)} of {len(items)} were done before.")
    if jobs <= 1 or len(left) <= 1:
        start: Callable[[], Work] = lambda: evaluator.evaluate  # noqa: E731 - the models are loaded already
        _do(plan, left, start, 1, say)
    else:
        del evaluator
        _do(plan, left, functools.partial(_start, plan), jobs, say)
    return write_report(plan.folder)


def rejudge(plan: Plan, *, say: Say = print) -> dict[str, Any]:
    """Assess all saved shapes of a folder again with the judges of `plan`, and rewrite the report.

    The plan comes from the folder's manifest (`training.evaluation.plan.plan_of`).

    Raises
    ------
    MeshdeformError
        The folder contains no run, or a model is not available.
    """
    stored = read_manifest(plan.folder)
    if stored is None:
        raise ParameterError(f"There is no run in {plan.folder}.", advice="Give the folder of a run with --out.")
    evaluator = _evaluator(plan, deforms=False)
    if plan.clip and not is_builtin(plan.params.model):
        refuse_the_guides_own(Path(plan.clip), plan.params.model, plan.revision)
    judge, clip = _judge_identities(plan, evaluator)
    for number, item in enumerate(items := plan.suite.items(), 1):
        if evaluator.rejudge(item) is not None:
            say(f"{number}/{len(items)}  {item.name}  judged again")
    write_manifest(plan.folder, {**stored, "judge": judge, "clip": clip})
    return write_report(plan.folder)


def _evaluator(plan: Plan, *, deforms: bool = True) -> Evaluator:
    return (DeliveredEvaluator if plan.suite.delivered else Evaluator)(plan, deforms=deforms)


def _start(plan: Plan) -> Work:
    return _evaluator(plan).evaluate


def _judge_identities(plan: Plan, evaluator: Evaluator) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the identities of the judge and of CLIP, or why there is none; check that the judge knows the prompts."""
    judge: dict[str, Any] = {"missing": "--judge none"}
    if plan.judge != NO_JUDGE and evaluator.judge is not None:
        try:
            evaluator.judge.log_likelihoods(source_mesh(plan.suite.sources[0]), plan.suite.prompts)
        except (PromptError, VocabularyError) as error:
            raise ParameterError(
                f"The judge does not know the prompts of the suite `{plan.suite.name}`: {error.detail}",
                advice="Use --judge none, and --clip FOLDER for a judge that reads any text.",
            ) from error
        judge = dict(evaluator.judge.identity)
    clip = dict(evaluator.clip.identity) if evaluator.clip else {"missing": "no folder was given with --clip"}
    return judge, clip


def _prepare(plan: Plan, expected: dict[str, Any]) -> None:
    (plan.folder / "sources").mkdir(parents=True, exist_ok=True)
    missing = [name for name in plan.suite.sources if not source_path(plan.folder, name).exists()]
    texels = {texels_path(plan.folder, name): source_texels(name) for name in missing}
    write_files({path: write_texels(image) for path, image in texels.items() if image is not None})
    write_files({source_path(plan.folder, name): write_ply(source_mesh(name)) for name in missing})
    write_manifest(plan.folder, expected)


def _do(plan: Plan, items: list[Item], start: Callable[[], Work], jobs: int, say: Say) -> None:
    for number, (item, result) in enumerate(each(items, start, jobs), 1):
        if isinstance(result, MeshdeformError):
            result = failed_record(plan.folder, item, WorkerLostError.__name__, result.detail)
        say(f"{number}/{len(items)}  {item.name}  {_outcome(result)}")


def _outcome(record: dict[str, Any]) -> str:
    if record["failed"]:
        return f"failed: {record['failed']['detail'].strip().splitlines()[-1]}"
    last = record["states"][-1]
    judged = last["judge"] or last["clip"]
    rank = f"rank {judged['rank']} ({judged['retrieved']})" if judged else "not judged"
    quality = last["quality"]
    return f"{rank}, {quality['flipped_faces']} flipped, {quality['self_intersections_added']} cut"
