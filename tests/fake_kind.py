"""A kind of job that needs no mesh and no torch: each step adds to a number, and the number is the whole state."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

from meshdeform.errors import CheckpointError
from meshdeform.requests.document import GuidanceKind
from meshdeform.runs.base import ArtifactData, RunInput, StepReport

__all__ = ["FakeKind", "OutOfMemoryError"]


class OutOfMemoryError(RuntimeError):
    """Called as torch's own."""


class _FakeRun:
    def __init__(self, kind: FakeKind, total_steps: int, value: int, step: int) -> None:
        self.total_steps, self.value, self._step, self._kind = total_steps, value, step, kind

    @property
    def step(self) -> int:
        return self._step

    def __iter__(self) -> Iterator[StepReport]:
        while self._step < self.total_steps:
            self._kind.on_step(self._step + 1)
            self._step += 1
            self.value = self.value * 3 + self._step
            yield StepReport(self._step, self.total_steps, {"total": 1.0 / self._step})

    def checkpoint(self) -> bytes:
        return json.dumps({"step": self._step, "value": self.value}).encode()

    def snapshot(self) -> ArtifactData:
        return ArtifactData(str(self.value).encode(), "model/gltf-binary")

    def finish(self) -> dict[str, ArtifactData]:
        self._kind.on_finish()
        return {"result.glb": self.snapshot()}


class FakeKind:
    """Starts fake runs and remembers with what input (`started`) and at which step (`started_at`).

    `on_step` is called in every step before anything is changed; it may raise, cancel, or stop the worker. `on_finish`
    is called after the last one.
    """

    def __init__(self) -> None:
        self.on_step: Callable[[int], None] = lambda step: None
        self.on_finish: Callable[[], None] = lambda: None
        self.started: list[RunInput] = []
        self.started_at: list[int] = []

    def start(self, given: RunInput) -> _FakeRun:
        """Take the place of `meshdeform.runs.start_run`."""
        self.started.append(given)
        params = given.request.params
        if params.kind is not GuidanceKind.TARGET:
            given.load_prior(params.model or given.default_model)
        state = {"step": 0, "value": 1}
        try:
            if given.initial is not None:
                state = {"step": 0, "value": json.loads(given.initial)["value"]}
            if given.checkpoint is not None:
                state = json.loads(given.checkpoint)
        except ValueError as error:
            raise CheckpointError("The checkpoint is torn.") from error
        self.started_at.append(state["step"])
        return _FakeRun(self, params.steps or 10, state["value"], state["step"])
