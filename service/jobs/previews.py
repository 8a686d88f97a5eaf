"""Make previews: what jobs would make of an asset, within seconds, in a process of its own; nothing is recorded."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from anyio import to_thread
from fastapi import Request

from meshdeform.api.limits import PREVIEW_S
from meshdeform.children.asking import ChildLostError
from meshdeform.children.protocol import StoppedError
from meshdeform.children.warm import Asked
from meshdeform.errors import DependencyError, ParameterError, UnavailableError
from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.runs.changes import asked_changes, is_change
from meshdeform.runs.kept_readings import FolderReadings, key_of
from meshdeform.words import in_use
from service.http.callers import while_waited_for
from service.http.forms import ReceivedFile
from service.jobs.documents import PreviewDocument
from service.jobs.intake import Submission, check, checked, ready
from service.state import AppState

As = Literal["positions", "glb"]
_ADVICE = "Send the job."
_CHANGES = "\nchanges"
"""After the id of an owner, which has no line break: the name of the process that makes plain changes."""
_SOON_S, _MOST_WAITING = 10.0, 2
"""How long a preview waits for its turn, and how many of one owner do."""


@dataclass(frozen=True)
class Preview:
    """The file of a preview, the SHA-256 of its asset, and whether it is a draft."""

    path: Path
    asset: str
    draft: bool


async def preview(
    app: AppState, request: Request, owner_id: str, submission: Submission, form: As, *, draft: bool
) -> Preview:
    """Make a preview in the folder of the submission; `draft`: of a fit a draft will do.

    Raises what a job's check and its run do, `LimitError` where too many are asked for, and UnavailableError where it
    takes too long. It ends when the caller goes.
    """
    task, asset = await app.take_in(owner_id, _task, app, owner_id, submission, form)
    task["draft"] = draft
    app.previews.prepare()
    changes = _changes(submission.document, asset[1])
    slots, copy = (app.changing, owner_id + _CHANGES) if changes else (app.naming, owner_id)
    async with while_waited_for(request) as asked, slots.slot(owner_id, soon_s=_SOON_S, most=_MOST_WAITING):
        found = await to_thread.run_sync(_answered, app, owner_id, copy, task, asset, asked)
    return Preview(Path(task["result"]), asset[0].sha256, found["draft"])


def _task(
    app: AppState, owner_id: str, submission: Submission, form: As
) -> tuple[dict[str, Any], tuple[ReceivedFile, ResolvedParams]]:
    """Check a request, and return the task of the process that makes its preview, its asset and its parameters."""
    document = submission.document
    assert isinstance(document, PreviewDocument)
    submission, words = ready(app, owner_id, submission)
    with in_use(words):
        params = check(submission.document, app.settings, files=submission.names)
        if not isinstance(params, ResolvedParams):
            raise ParameterError("Jobs of this kind have no preview.", advice=_ADVICE)
        _refuse_slow(submission.document, params)
        files = checked(app, owner_id, submission, look=False).files
    seeds = list(dict.fromkeys(document.seeds)) or [params.seed]
    if form == "glb" and len(seeds) > 1:
        raise ParameterError.at(["seeds"], "A GLB has one shape.", "Give one seed, or ask for positions.")
    asset, limits = files["asset"], app.assets.limits
    app.kept_assets.keep(owner_id, asset)
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
    }
    return task, (asset, params)


def _changes(request: JobRequest, params: ResolvedParams) -> bool:
    """Return whether a request asks for a change in plain words, whatever the asset is: a moment's work."""
    sentence = asked_changes(request.prompt, params)
    return sentence is not None and is_change(sentence)


def _refuse_slow(request: JobRequest, params: ResolvedParams) -> None:
    """Refuse what an optimiser makes, which takes longer than anybody looks on."""
    if params.guidance is GuidanceKind.EXEMPLAR or _changes(request, params):
        return
    raise ParameterError.at(
        ["params", "guidance", "kind"],
        f"`{params.guidance}` guidance has no preview: its jobs take longer.",
        "Set params.guidance.kind to exemplar, or send the job.",
    )


def _answered(
    app: AppState,
    owner_id: str,
    copy: str,
    task: dict[str, Any],
    asset: tuple[ReceivedFile, ResolvedParams],
    asked: Asked,
) -> dict[str, Any]:
    """Let a process of the owner carry out the task, with the reading of the asset that is kept; keep a new one.

    `copy`: the name of the process.
    """
    folder = app.workspace.folder / f"readings-{hashlib.sha256(owner_id.encode()).hexdigest()[:16]}"
    folder.mkdir(exist_ok=True)
    task = {**task, "readings": str(folder.absolute())}
    file, params = asset
    key = key_of(file.sha256, Path(file.filename).suffix, params)
    here = FolderReadings(folder)
    known = here.get(key)
    if known is None and (kept := app.readings.get(key)) is not None:
        here.put(key, kept)
        known = kept
    try:
        found: dict[str, Any] = app.previews.ask(copy, task, PREVIEW_S, asked)
    except StoppedError:
        return {}
    except TimeoutError as error:
        raise UnavailableError(f"A preview of this takes longer than {PREVIEW_S:g} s.", advice=_ADVICE) from error
    except ChildLostError as error:
        raise UnavailableError("The process that made the preview has ended.", advice=_ADVICE) from error
    except DependencyError as error:
        lacks = "Previews are made with the extra `deform`, which the API of this server lacks"
        raise DependencyError(f"{lacks}: {error.detail}", advice=_ADVICE) from error
    finally:
        if (made := here.get(key)) is not None and made != known:
            app.readings.put(key, made)
    return found
