"""Make previews: what jobs would make of an asset, within seconds, in a process of its own; nothing is recorded.

What takes a moment has turns and a process of its own: drafts, and changes in plain words, of an asset that was read.
Of these, the shape that a request itself has is urgent, and comes before other seeds of it. Shapes that drafts stand
for wait for each other, and get of the processor what is left.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from anyio import to_thread
from fastapi import Request

from meshdeform.api.states import PREVIEW_S
from meshdeform.assets.limits import error_from
from meshdeform.errors import DependencyError, ParameterError, UnavailableError
from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.runs.changes import asked_changes, is_change
from meshdeform.runs.kept_readings import FolderReadings, key_of
from meshdeform.runs.warm_processes import Asked, StoppedError
from meshdeform.words import in_use
from service.http.callers import while_waited_for
from service.jobs.documents import PreviewDocument
from service.jobs.intake import Submission, check_files, check_params, ready
from service.state import AppState

As = Literal["positions", "glb"]
_ADVICE = "Send the job."
_SOON_S, _LATE_S, _MOST_WAITING = 10.0, PREVIEW_S, 2
"""How long what takes a moment waits for its turn, how long others do, and how many of one owner."""
_YIELDING = 5
"""By how much nicer the process is that makes the others."""


@dataclass(frozen=True)
class Preview:
    """The file of a preview, the SHA-256 of its asset, and whether it is a draft."""

    path: Path
    asset: str
    draft: bool


async def preview(
    app: AppState, request: Request, owner_id: str, submission: Submission, form: As, *, draft: bool
) -> Preview:
    """Make a preview in the folder of the submission; `draft`: a draft will do.

    Raises what a job's check and its run do, `LimitError` where too many are asked for, and UnavailableError where it
    takes too long. It ends when the caller goes.
    """
    question = await app.take_in(owner_id, _question, app, owner_id, submission, form, draft)
    app.previews.prepare()
    async with while_waited_for(request) as asked, _turn(app, owner_id, question):
        found = await to_thread.run_sync(_answered, app, question, asked)
    return Preview(Path(question.task["result"]), question.asset, found["draft"])


@dataclass(frozen=True)
class _Question:
    """What a process is asked, and how long that may take.

    `task`: the process's; `asset`: its SHA-256; `owner`: the name of the process; `quick`: whether it takes a moment,
    once the asset is read; `own`: whether the shape is that of the request, not of other seeds; `readings` and `key`:
    where its reading is, `known` if it is known.
    """

    task: dict[str, Any]
    asset: str
    owner: str
    quick: bool
    own: bool
    readings: FolderReadings
    key: str
    known: bytes | None


def _turn(app: AppState, owner_id: str, question: _Question) -> AbstractAsyncContextManager[None]:
    if question.quick and question.known is not None:
        return app.drafting.slot(owner_id, soon_s=_SOON_S, most=_MOST_WAITING, urgent=question.own)
    return app.fitting.slot(owner_id, soon_s=_LATE_S, most=_MOST_WAITING, urgent=question.quick)


def _question(app: AppState, owner_id: str, submission: Submission, form: As, draft: bool) -> _Question:
    """Check a request, and return what the process that makes its preview is asked."""
    document = submission.document
    assert isinstance(document, PreviewDocument)
    submission, words = ready(app, owner_id, submission)
    with in_use(words):
        params = check_params(submission.document, app.settings, files=submission.names)
        if not isinstance(params, ResolvedParams):
            raise ParameterError("Jobs of this kind have no preview.", advice=_ADVICE)
        is_change = _refuse_slow(submission.document, params)
        files = submission.fetch_all(app, owner_id)
        check_files(app, owner_id, submission.document, params, files)
    seeds = list(dict.fromkeys(document.seeds)) or [params.seed]
    if form == "glb" and len(seeds) > 1:
        raise ParameterError.at(["seeds"], "A GLB has one shape.", "Give one seed, or ask for positions.")
    asset, limits, quick = files["asset"], app.assets.limits, draft or is_change
    app.kept_assets.keep(owner_id, asset)
    folder = app.workspace.folder / f"readings-{hashlib.sha256(owner_id.encode()).hexdigest()[:16]}"
    folder.mkdir(exist_ok=True)
    request = submission.document.model_dump(
        mode="json", exclude_unset=True, exclude={*PreviewDocument.model_fields} - {*JobRequest.model_fields}
    )
    samples = app.readings.samples
    task = {
        "request": request,
        "resolved": params.model_dump(mode="json"),
        "seeds": seeds,
        "as": form,
        "files": {
            name: {"path": str(file.path.absolute()), "filename": file.filename, "sha256": file.sha256}
            for name, file in files.items()
        },
        "limits": asdict(limits),
        "default_model": app.settings.model,
        "samples": None if samples is None else str(samples.absolute()),
        "result": str(submission.folder.absolute() / "preview"),
        "readings": str(folder.absolute()),
        "draft": draft,
        **({} if quick else {"nice": _YIELDING}),
    }
    key, here = key_of(asset.sha256, Path(asset.filename).suffix, params), FolderReadings(folder)
    known = here.get(key)
    if known is None and (known := app.readings.get(key)) is not None:
        here.put(key, known)
    name = f"{owner_id}, drafts" if quick else owner_id
    return _Question(task, asset.sha256, name, quick, seeds == [params.seed], here, key, known)


def _refuse_slow(request: JobRequest, params: ResolvedParams) -> bool:
    """Return whether a change in plain words is asked for; refuse what an optimiser makes, which takes long."""
    sentence = asked_changes(request.prompt, params)
    changes = sentence is not None and is_change(sentence)
    if params.guidance is GuidanceKind.EXEMPLAR or changes:
        return changes
    raise ParameterError.at(
        ["params", "guidance", "kind"],
        f"`{params.guidance}` guidance has no preview: its jobs take longer.",
        "Set params.guidance.kind to exemplar, or send the job.",
    )


def _answered(app: AppState, question: _Question, asked: Asked) -> dict[str, Any]:
    """Let a process of the owner carry out the task, with the reading of the asset that is kept; keep a new one."""
    try:
        verdict = app.previews.ask(question.owner, question.task, PREVIEW_S, asked)
    except StoppedError:
        return {}
    except TimeoutError as error:
        raise UnavailableError(f"A preview of this takes longer than {PREVIEW_S:g} s.", advice=_ADVICE) from error
    if (made := question.readings.get(question.key)) is not None and made != question.known:
        app.readings.put(question.key, made)
    if verdict is None:
        raise UnavailableError("The process that made the preview has ended.", advice=_ADVICE)
    if not verdict["ok"]:
        raise _error(verdict["error"])
    found: dict[str, Any] = verdict["found"]
    return found


def _error(told: Mapping[str, Any]) -> Exception:
    if told["code"] == DependencyError.code:
        lacks = "Previews are made with the extra `deform`, which the API of this server lacks"
        return DependencyError(f"{lacks}: {told['detail']}", advice=_ADVICE)
    return error_from(dict(told))
