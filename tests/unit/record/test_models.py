from __future__ import annotations

import pytest
from pydantic import ValidationError

from meshdeform.errors import WorkerLostError
from meshdeform.record.models import TERMINAL_STATES, EventType, JobError, JobState, Progress
from tests.cases import each_case


def test_the_events_that_end_a_job_are_named_like_the_states_that_it_ends_in() -> None:
    assert {happened.value for happened in EventType if happened.terminal} == {state.value for state in TERMINAL_STATES}
    assert {state for state in JobState if state.terminal} == TERMINAL_STATES
    assert not {"queued", "running", "canceling"} & {state.value for state in TERMINAL_STATES}


def test_every_state_but_running_is_an_event() -> None:
    """A worker's `started` makes a job run; every other state comes with an event of its name."""
    assert {state.value for state in JobState} - {happened.value for happened in EventType} == {"running"}


def test_an_error_is_kept_with_all_that_a_user_needs() -> None:
    error = WorkerLostError("The workers of 3 attempts died.")
    kept = JobError.of(error)
    assert (kept.code, kept.detail, kept.status) == (error.code, "The workers of 3 attempts died.", error.status)
    assert kept.title
    assert kept.advice
    assert JobError.model_validate(kept.model_dump()) == kept


@each_case("wrong", [{"step": -1}, {"fraction": 1.5}, {"fraction": -0.1}, {"eta_s": -1.0}])
def test_progress_that_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        Progress.model_validate(wrong)
