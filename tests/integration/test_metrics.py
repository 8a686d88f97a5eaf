"""`/metrics`, read by Prometheus' own parser."""

from __future__ import annotations

import pytest
import sqlalchemy as sa
from prometheus_client.parser import text_string_to_metric_families

from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.models import JobState
from meshdeform.record.schema import metadata
from tests.claims import claim_job
from tests.integration.conftest import Api, new_job

Samples = dict[tuple[str, tuple[tuple[str, str], ...]], float]


@pytest.fixture(autouse=True)
def _empty(api: Api) -> None:
    with api.record.database.write() as connection:
        for table in reversed(metadata.sorted_tables):
            connection.execute(sa.delete(table))


def scraped(api: Api) -> Samples:
    answer = api.http.get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain")
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }


def value(samples: Samples, name: str, **labels: str) -> float:
    return samples[f"meshdeform_{name}", tuple(sorted(labels.items()))]


@pytest.mark.both_databases
def test_the_record_is_counted(api: Api) -> None:
    jobs = [new_job(api.record) for _ in range(4)]
    claim_job(api.record.leases, jobs[0].id, "a worker", 60.0)
    api.record.leases.finish(jobs[0].id, 1, JobState.SUCCEEDED, step_s=0.03)
    claim_job(api.record.leases, jobs[1].id, "a worker", 60.0)
    api.record.leases.worker_ended("a worker")
    api.record.upkeep.reclaim_expired(max_attempts=3)
    api.record.request_cancel(jobs[2].id)
    api.record.leases.idle(WorkerIdentity("a worker", api.settings.queue, "cpu"))
    api.record.leases.idle(WorkerIdentity("of another queue", "another", "cpu"))
    samples = scraped(api)
    assert value(samples, "record_up") == 1
    assert value(samples, "jobs", state="queued") == 2
    assert value(samples, "jobs_ended_total", state="succeeded") == 1
    assert value(samples, "jobs_ended_total", state="canceled") == 1
    assert value(samples, "queue_depth") == 2
    assert value(samples, "queue_oldest_seconds") >= 0
    assert value(samples, "workers_alive") == 1
    assert value(samples, "lease_expirations_total") == 1
    assert value(samples, "recoveries_total") == 1
    assert value(samples, "queue_wait_seconds_count") == 2
    assert value(samples, "job_seconds_count") == 1
    assert value(samples, "step_seconds_bucket", le="0.025") == 0
    assert value(samples, "step_seconds_bucket", le="0.05") == 1
    assert value(samples, "step_seconds_bucket", le="+Inf") == 1
    assert value(samples, "step_seconds_sum") == pytest.approx(0.03)
    api.record.delete(jobs[0].id)
    assert value(scraped(api), "jobs_ended_total", state="succeeded") == 1, "sums outlive the jobs that made them"


def test_requests_are_counted_by_route_and_no_label_holds_an_id(api: Api) -> None:
    job = new_job(api.record)
    before = scraped(api)
    api.http.get(f"/v1/jobs/{job.id}")
    api.http.get("/v1/jobs/job_00000000000000000000000000")
    api.http.get(f"/nothing/here/{job.id}")
    api.http.patch(f"/v1/jobs/{job.id}")
    after = scraped(api)

    def more(method: str, route: str, status: str) -> float:
        key = ("meshdeform_http_requests_total", (("method", method), ("route", route), ("status", status)))
        return after.get(key, 0.0) - before.get(key, 0.0)

    assert more("GET", "/v1/jobs/{id}", "200") == 1
    assert more("GET", "/v1/jobs/{id}", "404") == 1
    assert more("GET", "other", "404") == 1
    assert more("PATCH", "/v1/jobs/{id}", "405") == 1
    assert not any(job.id in str(key) for key in after)
