"""What `/metrics` says of a record that cannot be read."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from prometheus_client import generate_latest
from prometheus_client.parser import text_string_to_metric_families

from meshdeform.errors import UnavailableError
from meshdeform.record.repository import JobRecord
from service.operations.metrics import Metrics


def _refuse(*_: Any) -> None:
    raise UnavailableError("The record does not answer.")


def test_a_record_that_does_not_answer_is_down_and_has_no_numbers() -> None:
    metrics = Metrics()
    metrics.watch(cast("JobRecord", SimpleNamespace(database=SimpleNamespace(read=_refuse))), "jobs")
    families = text_string_to_metric_families(generate_latest(metrics.registry).decode())
    samples = {sample.name: sample.value for family in families for sample in family.samples}
    assert samples["meshdeform_record_up"] == 0
    assert not any(name.startswith(("meshdeform_jobs", "meshdeform_queue")) for name in samples)
