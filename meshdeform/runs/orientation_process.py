"""Find the front of an asset in a child process, so that a process without torch can ask for it before a job starts.

`orientation_of` imports neither torch nor numpy. The child has no secrets in its environment, and bounded memory and
time. It knows only the builtin prior, the one that is conditioned on the azimuth.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshdeform.assets.limits import Limits
from meshdeform.errors import ParameterError
from meshdeform.requests.choices import GuidanceKind, OrientationMode, is_builtin, is_sent
from meshdeform.requests.document import BUILTIN_MODEL, JobRequest, ResolvedParams
from meshdeform.runs.base import job_input
from meshdeform.runs.questions import Question, answer_task

_QUESTION = Question(
    __name__,
    cannot="The front cannot be found on this server.",
    lacks="The front is found with the extra `deform`, which the API of this server lacks",
    instead="Send the job; its report says which side became the front. Or run `meshdeform inspect ASSET --prompt "
    "TEXT`.",
)


def check_searchable(params: ResolvedParams) -> None:
    """Refuse to search a front that a job with these parameters would not search."""
    if params.guidance is GuidanceKind.EXEMPLAR:
        detail = "With `exemplar` guidance, the front is that of the asset's reading, which a list of its parts has."
        raise ParameterError.at(["params", "guidance"], detail, "Ask for its parts: POST /v1/jobs:parts.")
    if params.guidance is not GuidanceKind.SDS:
        raise ParameterError.at(
            ["params", "guidance"], "A target has no front to find: `align` places it.", "Omit this request."
        )
    if params.orientation is not OrientationMode.AUTO:
        detail = f"params.guidance.orientation is {params.orientation}, so the job would not search its front."
        raise ParameterError.at(["params", "guidance", "orientation"], detail, "Set it to auto.")
    if not is_builtin(params.model):
        detail = "This model is not conditioned on the azimuth, so no side of the asset is its front."
        advice = f"Use {BUILTIN_MODEL}, or start the job as it is."
        raise ParameterError.at(["params", "guidance", "model"], detail, advice)
    if is_sent(params.model):
        detail = "The front is found by models of this server, not by weights of a job."
        advice = f"Use {BUILTIN_MODEL}, or start the job, which searches its front itself."
        raise ParameterError.at(["params", "guidance", "model"], detail, advice)


def orientation_of(
    asset: Path,
    filename: str,
    prompt: str,
    params: ResolvedParams,
    *,
    subdivide: bool = False,
    limits: Limits,
    dtype: str = "auto",
    timeout_s: float,
) -> dict[str, Any]:
    """Return the orientation that a job would have, as its report would describe it.

    `filename`: its name; the extension decides the format where the content does not. `params`: `check_searchable`
    accepts them; `subdivide`: `output.subdivide` of the job; `dtype`: precision of the model, as for `load_prior`.
    """
    task = {
        "suffix": Path(filename).suffix[:16],
        "request": {"prompt": prompt, "output": {"subdivide": subdivide}},
        "params": params.model_dump(mode="json"),
        "limits": asdict(limits),
        "dtype": dtype,
    }
    answer: dict[str, Any] = _QUESTION.ask_about(asset, task, timeout_s)
    return answer


def main(arguments: list[str] | None = None) -> int:
    """Carry out the task in a file of JSON, and print a JSON verdict with the orientation or what went wrong."""
    return answer_task(_find, arguments)


def _find(task: dict[str, Any]) -> dict[str, Any]:
    from meshdeform.priors import hidden_folders, load_prior
    from meshdeform.runs import text_deform
    from meshdeform.runs.devices import use_threads

    use_threads(1)
    params = ResolvedParams.model_validate(task["params"])
    with hidden_folders([params.model]):
        prior = load_prior(params.model, device="cpu", dtype=task["dtype"])
    run = text_deform.start(
        job_input(
            asset=Path(task["asset"]).read_bytes(),
            filename=f"asset{task['suffix']}",
            request=JobRequest.model_validate(task["request"]),
            prior=prior,
            limits=Limits(**task["limits"]),
            resolved=params,
        )
    )
    if not isinstance(run, text_deform.TextDeformRun):
        raise ParameterError.at(["prompt"], "A change in plain words has no front to find.", "Start the job as it is.")
    return run.orientation.to_dict()
