"""Claim one job of a record that has others, which workers cannot: `Leases.claim_next` chooses."""

from __future__ import annotations

from meshdeform.record.leases import Leases
from meshdeform.record.models import Job
from meshdeform.record.schema import jobs
from meshdeform.record.turns import USUAL

__all__ = ["claim_job"]


def claim_job(leases: Leases, job_id: str, worker_id: str, lease_s: float) -> Job | None:
    """Claim a queued job as a new attempt. None: it is not queued, is over, was deleted, or cannot be read here."""
    return leases._claim(lambda readable: (readable.where(jobs.c.id == job_id),), worker_id, lease_s, USUAL)
