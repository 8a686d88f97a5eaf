"""Run rows of a local batch: one JSON order per line on standard input, answers on standard output."""

from __future__ import annotations

import functools
import json
import os
import queue
import signal
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from meshdeform.errors import CheckpointError, MeshdeformError

if TYPE_CHECKING:
    from meshdeform.cli.local import FinishedRun
    from meshdeform.requests.document import JobRequest

__all__ = ["main"]

_TICK_EVERY_S = 0.25


def main() -> None:
    """Process orders until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Keep what libraries print out of the answers.
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    orders: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(orders,), name="orders", daemon=True).start()
    while True:
        order = orders.get()
        try:
            done = _do(order, _Ticks(answers))
        except MeshdeformError as error:
            done = {"event": "failed", "error": _error(error.code, error.detail, error.advice_text)}
        except Exception as error:  # a bug fails its row and is reported
            traceback.print_exc()
            done = {"event": "failed", "error": _error("internal", f"{type(error).__name__}: {error}", "Report this.")}
        print(json.dumps(done), file=answers, flush=True)


def _read(orders: queue.SimpleQueue[dict[str, Any]]) -> None:
    for line in sys.stdin:
        orders.put(json.loads(line))
    # The parent has ended, perhaps during a row, and nothing can record a result.
    os._exit(0)


def _error(code: str, detail: str, advice: str) -> dict[str, str]:
    return {"code": code, "detail": detail, "advice": advice}


class _Ticks:
    """Passes on steps, at most four per second."""

    def __init__(self, answers: IO[str]) -> None:
        self._answers, self._last = answers, 0.0

    def phase(self, name: str) -> None:
        """Ignore phases."""

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:  # noqa: ARG002
        now = time.monotonic()
        if step == total_steps or now - self._last >= _TICK_EVERY_S:
            self._last = now
            tick = {"event": "step", "step": step, "total_steps": total_steps, "loss": loss}
            print(json.dumps(tick), file=self._answers, flush=True)


def _do(order: dict[str, Any], ticks: _Ticks) -> dict[str, Any]:
    from meshdeform.cli.environment import load_settings
    from meshdeform.cli.local import LocalJob
    from meshdeform.requests.document import JobRequest

    folder, state = Path(order["folder"]), Path(order["state"])
    request = JobRequest.model_validate(order["request"])
    names = ["result.glb", "report.json", "preview.png", *(["morph.glb"] if request.output.morph else [])]
    files = {part: Path(order[part]) for part in ("asset", "target") if order[part]}

    def run(resume: Path | None) -> FinishedRun:
        settings, outputs = load_settings(**order["settings"]), {name: folder / name for name in names}
        job = LocalJob(request, files, outputs, settings, checkpoint=state, resume=resume, load=_prior_loader())
        return job.run(ticks)

    try:
        finished = run(state if state.exists() else None)
    except CheckpointError:
        # The checkpoint is damaged or of another version: start over.
        state.unlink(missing_ok=True)
        finished = run(None)
    state.unlink(missing_ok=True)
    return {
        "event": "done",
        "elapsed_s": finished.elapsed_s,
        "losses": finished.losses,
        "files": _digests(folder, request),
    }


@functools.cache
def _prior_loader() -> Any:
    from meshdeform.priors import load_prior

    return functools.lru_cache(maxsize=1)(load_prior)


def _digests(folder: Path, request: JobRequest) -> dict[str, str]:
    from meshdeform.runs import kind_of
    from meshdeform.runs.report import sha256_hex

    names = [artifact.name for artifact in kind_of(request.kind).artifacts]
    return {name: sha256_hex((folder / name).read_bytes()) for name in names if (folder / name).exists()}


if __name__ == "__main__":
    main()
