"""Run rows on a service: submit each once, follow it through interruptions, fetch its artifacts."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import Row
from meshdeform.cli.batches.work import RowOutcome, Tick
from meshdeform.cli.fetch import save_artifacts
from meshdeform.cli.following import Deadline, follow
from meshdeform.errors import (
    AssetError,
    ConflictError,
    LimitError,
    ModelError,
    NotFoundError,
    RequestError,
    TooMuchStoredError,
)

if TYPE_CHECKING:
    from meshdeform.api.jobs import EventView, JobView
    from meshdeform.client import Client

__all__ = ["ServiceRunner"]

_ENDED = {"failed": "failed", "canceled": "was canceled", "expired": "expired"}
_LIMIT_PAUSE_S = 5.0
_LIMIT_TIMEOUT_S = 3600.0


class ServiceRunner:
    """Runs rows as jobs of a service.

    A row's Idempotency-Key consists of the batch, the row's key and its number of failures. If the process dies between
    the response and the line in the ledger, the next run therefore gets the same job, not a second one.

    Parameters
    ----------
    client : Client
    ledger : Ledger
    folder : Path
    """

    def __init__(self, client: Client, ledger: Ledger, folder: Path) -> None:
        self._client, self._ledger, self._folder = client, ledger, folder
        self._stop = threading.Event()

    def do(self, row: Row, on_tick: Callable[[Tick], None]) -> RowOutcome:
        """Find or submit the row's job, wait for it and fetch its artifacts."""
        start = time.monotonic()
        try:
            job = self._existing_job(row) or self._submit(row)
            if not job.state.terminal:
                job = follow(self._client, job.id, partial(_pass_on, on_tick), deadline=Deadline(None))
            return self._outcome(row, job, start)
        except (AssetError, RequestError, ModelError, NotFoundError, ConflictError) as error:
            # Refused by the service, or deleted meanwhile; other rows can go on.
            refused = {"code": error.code, "detail": error.detail, "advice": error.advice_text}
            return RowOutcome("failed", round(time.monotonic() - start, 3), error=refused)

    def close(self) -> None:
        """Close the connections; jobs continue, and the same command finds them again."""
        self._stop.set()
        self._client.close()

    def _existing_job(self, row: Row) -> JobView | None:
        line = self._ledger.last.get(row.key, {})
        if line.get("event") not in ("submitted", "done") or not line.get("job_id"):
            return None
        try:
            return self._client.get(line["job_id"])
        except NotFoundError:
            # Deleted, or on another service: its Idempotency-Key must not be used again.
            self._ledger.append("failed", row.key, row.name, job_id=line["job_id"], error={"code": "not_found"})
            return None

    def _submit(self, row: Row) -> JobView:
        tries = self._ledger.tries.get(row.key, 0)
        deadline = time.monotonic() + _LIMIT_TIMEOUT_S
        while True:
            try:
                job = self._client.submit(
                    row.asset,
                    row.request.prompt,
                    params=row.request.params,
                    output=row.request.output,
                    target=row.target,
                    metadata={"batch": self._ledger.batch_id, "row": row.name},
                    idempotency_key=f"batch-{self._ledger.batch_id}-{row.key}-{tries}",
                )
            except TooMuchStoredError:
                raise
            except LimitError:
                # Wait until other rows of this batch have ended.
                if time.monotonic() > deadline or self._stop.wait(_LIMIT_PAUSE_S):
                    raise
            else:
                self._ledger.append("submitted", row.key, row.name, job_id=job.id, **{"try": tries})
                return job

    def _outcome(self, row: Row, job: JobView, start: float) -> RowOutcome:
        if job.state.value != "succeeded":
            error = {"code": f"job_{job.state.value}", "detail": f"The job {_ENDED[job.state.value]}.", "advice": ""}
            if job.error is not None:
                error = {"code": job.error.code, "detail": job.error.detail, "advice": job.error.advice}
            return RowOutcome(job.state.value, round(time.monotonic() - start, 3), job.id, error=error)
        files = save_artifacts(self._client, job.id, self._folder / row.name)
        seconds = time.monotonic() - start
        if job.finished_at is not None:
            seconds = (job.finished_at - job.created_at).total_seconds()
        digests = {str(file["name"]): str(file["sha256"]) for file in files}
        return RowOutcome("succeeded", round(seconds, 3), job.id, digests, dict(job.progress.losses))


def _pass_on(on_tick: Callable[[Tick], None], event: EventView) -> None:
    if event.type.value == "progress" and (total := int(event.data.get("total_steps", 0))):
        loss = (event.data.get("losses") or {}).get("total", math.nan)
        on_tick(Tick(int(event.data.get("step", 0)), total, loss, event.data.get("eta_s")))
