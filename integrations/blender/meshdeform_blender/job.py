"""Run one job, from submission to result, on its own thread, so that Blender stays usable. Does not use bpy."""

from __future__ import annotations

import secrets
import threading
import time
from dataclasses import dataclass, replace
from typing import Any, Literal

from .client import Client
from .errors import AddonError, Canceled

Phase = Literal["sending", "queued", "running", "receiving", "succeeded", "failed", "canceled"]
OVER: frozenset[Phase] = frozenset({"succeeded", "failed", "canceled"})
_POLL_S = 1.0  # a bar that moves once a second looks alive
_CONTACT_S = 10.0


@dataclass(frozen=True)
class Status:
    """The state of a job. Immutable and replaced as a whole, so any thread may read it."""

    phase: Phase = "sending"
    fraction: float = 0.0  # of the optimisation, 0 to 1
    step: int = 0
    total_steps: int = 0
    job_id: str = ""  # empty until the service has accepted the job
    error: AddonError | None = None

    @property
    def text(self) -> str:
        """The phase in words for the panel."""
        if self.phase == "running" and self.total_steps:
            return f"Step {self.step} of {self.total_steps}"
        texts = {
            "sending": "Sending",
            "queued": "Waiting for a worker",
            "running": "Starting",
            "receiving": "Receiving",
        }
        return texts.get(self.phase, self.phase.capitalize())


class JobThread(threading.Thread):
    """A thread that submits a job, follows it and downloads `result.glb`.

    Parameters
    ----------
    url, api_key : str
        Address and key of the service.
    asset : bytes
        A GLB.
    request : dict
        The request document.
    target : bytes, optional
        A GLB with the target mesh, for `target` guidance.

    Attributes
    ----------
    result : bytes or None
        Once `status.phase` is `succeeded`.
    """

    def __init__(
        self, url: str, api_key: str, asset: bytes, filename: str, request: dict[str, Any], target: bytes | None = None
    ) -> None:
        super().__init__(name="meshdeform", daemon=True)
        self._stop_asked = threading.Event()
        self._client = Client(url, api_key, stop=self._stop_asked)
        self._first_client = Client(url, api_key, stop=self._stop_asked, timeout_s=_CONTACT_S, tries=1)
        # This client has no stop event: it sends the cancellation after the other one was stopped.
        self._canceling_client = Client(url, api_key, timeout_s=_CONTACT_S)
        self._asset, self._filename, self._request, self._target = asset, filename, request, target
        self.status = Status()
        self.result: bytes | None = None

    def cancel(self) -> None:
        """Request cancellation; returns at once."""
        self._stop_asked.set()

    def run(self) -> None:
        """Run the job; afterwards `status.phase` is one of `OVER`."""
        try:
            self.result = self._run()
            self.status = replace(self.status, phase="succeeded", fraction=1.0)
        except Canceled:
            self._cancel_job()
            self.status = replace(self.status, phase="canceled")
        except AddonError as error:
            self.status = replace(self.status, phase="failed", error=error)
        except Exception as error:  # the panel must show any error instead of waiting for ever
            mistake = AddonError(f"{type(error).__name__}: {error}", "Report this to the add-on's authors.")
            self.status = replace(self.status, phase="failed", error=mistake)

    def _run(self) -> bytes:
        # Report a wrong address or key at once; later the service may be unreachable for a while.
        self._first_client.version()
        key = secrets.token_hex(16)
        job = self._client.submit(self._asset, self._filename, self._request, target=self._target, key=key)
        self.status = replace(self.status, phase="queued", job_id=str(job["id"]))
        while True:
            if self._stop_asked.is_set():
                raise Canceled
            job, after_s = self._client.job(self.status.job_id)
            self._note(job)
            if job["state"] == "succeeded":
                break
            if job["state"] in {"failed", "canceled", "expired"}:
                raise _ended(job)
            if self._stop_asked.wait(min(after_s, _POLL_S)):
                raise Canceled
        self.status = replace(self.status, phase="receiving", fraction=1.0)
        result = self._client.artifact(self.status.job_id, "result.glb")
        if self._stop_asked.is_set():
            raise Canceled
        return result

    def _note(self, job: dict[str, Any]) -> None:
        progress = job["progress"]
        self.status = replace(
            self.status,
            phase="queued" if job["state"] == "queued" else "running",
            fraction=float(progress["fraction"]),
            step=int(progress["step"]),
            total_steps=int(progress["total_steps"]),
        )

    def _cancel_job(self) -> None:
        """Cancel the job on the server, ignoring errors: the user has moved on."""
        deadline = time.monotonic() + _CONTACT_S
        while self.status.job_id and time.monotonic() < deadline:
            try:
                self._canceling_client.cancel(self.status.job_id)
            except AddonError:
                time.sleep(0.2)
            else:
                return


def _ended(job: dict[str, Any]) -> AddonError:
    error = job.get("error") or {}
    return AddonError(
        str(error.get("detail") or f"The job was {job['state']} on the server."),
        str(error.get("advice") or ""),
        str(error.get("code") or ""),
    )
