"""The record's tables. `migrations/` creates and changes them; a test compares the two."""

from __future__ import annotations

import sqlalchemy as sa

from meshdeform.record.columns import UtcDateTime

HEAD = "0014"
"""The newest migration. A record at this version is opened without Alembic.

The first two digits are its generation. Within one, migrations only add, so that two versions of Meshdeform can use a
record at once; what takes away or renames begins the next generation, "0100", and needs a stop of all processes. They
are never merged, so that the record of any commit can be upgraded (`scripts/upgrade-test`).
"""
ORIGIN = "(origin)"
"""The `part` of the checkpoint of a job's origin in `job_files`; the fields of a kind of job are identifiers."""
# Byte order, whatever the database's locale: ids sort by time.
_ID = sa.String(64).with_variant(sa.String(64, collation="C"), "postgresql")

metadata = sa.MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "pk": "pk_%(table_name)s",
    }
)

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", _ID, primary_key=True),
    # The owner, named by every look-up of a user. Empty if keys are off.
    sa.Column("owner_id", sa.String(64), nullable=False),
    sa.Column("kind", sa.String(32), nullable=False),
    # Jobs with the same workload take about the same time per step: the basis of estimates.
    sa.Column("workload", sa.String(600), nullable=False),
    sa.Column("state", sa.String(16), nullable=False),
    # As written by the user; the values that run are in `resolved`.
    sa.Column("request", sa.JSON, nullable=False),
    sa.Column("resolved", sa.JSON(none_as_null=True)),
    # Its files by field; `job_files` is their index.
    sa.Column("files", sa.JSON, nullable=False),
    # For a job that continues another one: a copy of that job's checkpoint, and its source.
    sa.Column("origin", sa.JSON(none_as_null=True)),
    sa.Column("error", sa.JSON(none_as_null=True)),
    # Higher values run first.
    sa.Column("priority", sa.Integer, nullable=False),
    sa.Column("deadline_at", UtcDateTime),
    sa.Column("retention_s", sa.Double),
    sa.Column("retain_until", UtcDateTime),
    sa.Column("request_id", sa.String(128)),
    sa.Column("traceparent", sa.String(64)),
    sa.Column("created_at", UtcDateTime, nullable=False),
    sa.Column("started_at", UtcDateTime),
    sa.Column("finished_at", UtcDateTime),
    sa.Column("version", sa.Integer, nullable=False),
    sa.Column("attempt", sa.Integer, nullable=False),
    # Attempts whose worker fell silent. Attempts that were handed back do not count.
    sa.Column("lost_attempts", sa.Integer, nullable=False),
    # Attempts that ran out of device memory.
    sa.Column("oom_attempts", sa.Integer, nullable=False),
    sa.Column("worker_id", sa.String(255)),
    sa.Column("lease_expires_at", UtcDateTime),
    # Since when its worker has it, and the seconds that earlier attempts ran.
    sa.Column("claimed_at", UtcDateTime),
    sa.Column("ran_s", sa.Double, nullable=False, server_default="0"),
    # When it was handed back so that others could run; it takes its turn as if it had been queued then.
    sa.Column("yielded_at", UtcDateTime),
    # Failures in a row that may pass, and the time before which it is not tried again.
    sa.Column("failures", sa.Integer, nullable=False, server_default="0"),
    sa.Column("retry_at", UtcDateTime),
    # Size of its mesh, the basis of estimates; null if unknown.
    sa.Column("faces", sa.Integer),
    sa.Column("parts", sa.Integer),  # its meshes
    # Sequence number of the newest event.
    sa.Column("event_seq", sa.Integer, nullable=False),
    sa.Column("step", sa.Integer, nullable=False),
    sa.Column("total_steps", sa.Integer, nullable=False),
    sa.Column("fraction", sa.Double, nullable=False),
    sa.Column("phase", sa.String(64), nullable=False),
    sa.Column("losses", sa.JSON, nullable=False),
    sa.Column("eta_s", sa.Double),
    # Mean seconds per step of the attempt that ended the job.
    sa.Column("step_s", sa.Double),
    # Bytes of its artifacts and checkpoints.
    sa.Column("stored_bytes", sa.BigInteger, nullable=False),
    # The versions of Meshdeform that computed its results, in order; null if unknown.
    sa.Column("made_by", sa.String(200)),
    sa.Index(None, "state", "id"),
    sa.Index(None, "owner_id", "id"),
    sa.Index(None, "owner_id", "state", "id"),
    sa.Index(None, "owner_id", "stored_bytes"),
    sa.Index(None, "workload", "state", "id"),
    sa.Index(None, "deadline_at"),
    sa.Index(None, "retain_until"),
    sa.Index(None, "worker_id"),
)
# The order in which workers claim jobs: by priority, and within one the owners in turn.
sa.Index("ix_jobs_urgency", jobs.c.state, jobs.c.priority.desc(), jobs.c.id)
sa.Index("ix_jobs_share", jobs.c.state, jobs.c.priority, jobs.c.owner_id, jobs.c.id)
_yielded = jobs.c.yielded_at.is_not(None)
sa.Index(None, jobs.c.state, jobs.c.yielded_at, sqlite_where=_yielded, postgresql_where=_yielded)

# The stored files that a job needs: those of its fields, and the checkpoint of its origin as `ORIGIN`. Never changed.
job_files = sa.Table(
    "job_files",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("part", sa.String(64), primary_key=True),
    sa.Column("owner_id", sa.String(64), nullable=False),
    sa.Column("key", sa.String(255), nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Index(None, "key"),
    sa.Index(None, "owner_id", "key", "size"),
)

# The text to search: prompt, file names and labels of a job. A table of its own is small enough to scan
# on SQLite. On PostgreSQL it has an index of trigrams, unless the server refuses that, so the migration makes it apart.
job_texts = sa.Table(
    "job_texts",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("text", sa.Text, nullable=False),
)
trigrams = sa.Index(None, job_texts.c.text, postgresql_using="gin", postgresql_ops={"text": "gin_trgm_ops"})
trigrams.ddl_if(callable_=lambda *_, **__: False)

# A job's metadata, for filters: the databases have no common way to index JSON.
labels = sa.Table(
    "labels",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("name", sa.String(64), primary_key=True),
    sa.Column("value", sa.String(500), nullable=False),
    sa.Index(None, "name", "value", "job_id"),
)

events = sa.Table(
    "events",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    # 1, 2, 3 ... without a gap: assigned under the lock on the job's row.
    sa.Column("seq", sa.Integer, primary_key=True),
    sa.Column("type", sa.String(32), nullable=False),
    sa.Column("at", UtcDateTime, nullable=False),
    sa.Column("attempt", sa.Integer, nullable=False),
    sa.Column("data", sa.JSON, nullable=False),
)

# Earlier versions write to it; what they would read there is compared with Redis instead (`reconciler.py`).
outbox = sa.Table(
    "outbox",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("created_at", UtcDateTime, nullable=False),
)

idempotency = sa.Table(
    "idempotency",
    metadata,
    sa.Column("owner_id", sa.String(64), primary_key=True),
    sa.Column("key", sa.String(255), primary_key=True),
    sa.Column("request_hash", sa.String(64), nullable=False),
    # Token of the request that holds the key: only that request may write the answer.
    sa.Column("token", sa.String(32), nullable=False),
    sa.Column("locked_until", UtcDateTime, nullable=False),
    # The answer; null while the request is in progress.
    sa.Column("response", sa.JSON(none_as_null=True)),
    sa.Column("created_at", UtcDateTime, nullable=False),
    sa.Index(None, "created_at"),
)

artifacts = sa.Table(
    "artifacts",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("name", sa.String(128), primary_key=True),
    sa.Column("attempt", sa.Integer, nullable=False),
    sa.Column("content_type", sa.String(128), nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("key", sa.String(255), nullable=False),
    sa.Column("created_at", UtcDateTime, nullable=False),
    # What its format cannot hold, in sentences; null if there are none.
    sa.Column("warnings", sa.JSON(none_as_null=True)),
)

checkpoints = sa.Table(
    "checkpoints",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("attempt", sa.Integer, primary_key=True),
    sa.Column("step", sa.Integer, primary_key=True),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("key", sa.String(255), nullable=False),
    # The mesh at that step, for people; null if it was not stored.
    sa.Column("mesh_key", sa.String(255)),
    sa.Column("mesh_sha256", sa.String(64)),
    sa.Column("mesh_size", sa.BigInteger),
    sa.Column("created_at", UtcDateTime, nullable=False),
    # The versions of Meshdeform that computed it, in order; null if unknown.
    sa.Column("made_by", sa.String(200)),
)

files = sa.Table(
    "files",
    metadata,
    sa.Column("key", sa.String(255), primary_key=True),
    # Number of requests that are about to create a job from this file; it must not be removed. -1 during its removal.
    sa.Column("pins", sa.Integer, nullable=False),
    sa.Column("touched_at", UtcDateTime, nullable=False),
)

uploads = sa.Table(
    "uploads",
    metadata,
    sa.Column("id", _ID, primary_key=True),
    sa.Column("owner_id", sa.String(64), nullable=False),
    sa.Column("filename", sa.String(200), nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    # As announced, if at all, until the upload is complete.
    sa.Column("sha256", sa.String(64)),
    # The stored file; null until it is complete.
    sa.Column("key", sa.String(255)),
    sa.Column("created_at", UtcDateTime, nullable=False),
    sa.Column("expires_at", UtcDateTime, nullable=False),
    sa.Index(None, "key"),
    sa.Index(None, "expires_at"),
)

# Words of an owner's own (`meshdeform.words`); the content of each is a stored file.
words = sa.Table(
    "words",
    metadata,
    sa.Column("owner_id", sa.String(64), primary_key=True),
    sa.Column("noun", sa.String(64), primary_key=True),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("key", sa.String(255), nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    # Its names, its parts, and where each of its shapes comes from.
    sa.Column("told", sa.JSON, nullable=False),
    # The number of faces of each shape.
    sa.Column("faces", sa.JSON, nullable=False),
    sa.Column("created_at", UtcDateTime, nullable=False),
    sa.Index(None, "key"),
)

api_keys = sa.Table(
    "api_keys",
    metadata,
    sa.Column("id", _ID, primary_key=True),
    sa.Column("owner_id", sa.String(64), nullable=False),
    sa.Column("name", sa.String(100), nullable=False),
    # SHA-256 of the secret; the secret itself is shown once and not stored.
    sa.Column("secret_hash", sa.String(64), nullable=False),
    sa.Column("created_at", UtcDateTime, nullable=False),
    sa.Column("last_used_at", UtcDateTime),
    sa.Column("revoked_at", UtcDateTime),
    # Null: the deployment's setting.
    sa.Column("requests_per_minute", sa.Integer),
    sa.Column("max_active_jobs", sa.Integer),
    sa.Column("max_priority", sa.Integer),
)

webhooks = sa.Table(
    "webhooks",
    metadata,
    sa.Column("id", _ID, primary_key=True),
    sa.Column("owner_id", sa.String(64), nullable=False),
    sa.Column("url", sa.String(2000), nullable=False),
    # Types of events to send; an empty list means all.
    sa.Column("events", sa.JSON, nullable=False),
    sa.Column("secret", sa.String(128), nullable=False),
    # Signs in addition to the new one until `previous_until`.
    sa.Column("previous_secret", sa.String(128)),
    sa.Column("previous_until", UtcDateTime),
    sa.Column("disabled_at", UtcDateTime),
    sa.Column("disabled_reason", sa.String(255)),
    sa.Column("created_at", UtcDateTime, nullable=False),
    # The one job that it is for; null: all of the owner.
    sa.Column("job_id", _ID),
    sa.Index(None, "owner_id", "id"),
    sa.Index(None, "job_id"),
)

# One message to one webhook, written with its event.
deliveries = sa.Table(
    "deliveries",
    metadata,
    sa.Column("id", _ID, primary_key=True),
    sa.Column("webhook_id", _ID, sa.ForeignKey("webhooks.id", ondelete="CASCADE"), nullable=False),
    # Empty if the message is not about a job.
    sa.Column("job_id", _ID, nullable=False),
    # The first delivery of this message, whose id is the message's id; null for the first delivery itself.
    sa.Column("replay_of", _ID),
    sa.Column("type", sa.String(64), nullable=False),
    sa.Column("payload", sa.JSON, nullable=False),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("attempts", sa.Integer, nullable=False),
    # Time of the next attempt; a sender postpones it before sending, so that no other sender takes the delivery.
    sa.Column("next_at", UtcDateTime),
    sa.Column("created_at", UtcDateTime, nullable=False),
    sa.Index(None, "state", "next_at"),
    sa.Index(None, "webhook_id", "id"),
    sa.Index(None, "created_at", "state"),
)

delivery_attempts = sa.Table(
    "delivery_attempts",
    metadata,
    sa.Column("delivery_id", _ID, sa.ForeignKey("deliveries.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("at", UtcDateTime, nullable=False),
    sa.Column("status", sa.Integer),
    sa.Column("error", sa.String(500)),
    sa.Column("seconds", sa.Double, nullable=False),
)

# Live worker processes.
workers = sa.Table(
    "workers",
    metadata,
    sa.Column("id", sa.String(255), primary_key=True),
    sa.Column("queue", sa.String(255), nullable=False),
    sa.Column("device", sa.String(32), nullable=False),
    sa.Column("started_at", UtcDateTime, nullable=False),
    sa.Column("seen_at", UtcDateTime, nullable=False),
)

# Who does the work that one process does for all; renewed while it lives.
leaders = sa.Table(
    "leaders",
    metadata,
    sa.Column("name", sa.String(255), primary_key=True),
    sa.Column("holder", sa.String(32), nullable=False),
    sa.Column("expires_at", UtcDateTime, nullable=False),
    sa.Column("looked_at", UtcDateTime, nullable=False),
    # Since when the holder has watched the leases of jobs without a gap; null if that is not its work.
    sa.Column("watching_since", UtcDateTime),
    # How many processes would do the work if the holder were gone.
    sa.Column("candidates", sa.Integer, nullable=False),
)

# Counters over all processes and restarts, for the metrics.
tallies = sa.Table(
    "tallies",
    metadata,
    sa.Column("name", sa.String(64), primary_key=True),
    sa.Column("label", sa.String(64), primary_key=True),
    sa.Column("value", sa.Double, nullable=False),
)

# What owners have used, by the month in UTC: "2026-11". Jobs that are deleted stay counted.
usage = sa.Table(
    "usage",
    metadata,
    sa.Column("owner_id", sa.String(64), primary_key=True),
    sa.Column("month", sa.String(7), primary_key=True),
    # Jobs that ended, in whichever state.
    sa.Column("jobs", sa.BigInteger, nullable=False),
    # For which workers had their jobs, all attempts together.
    sa.Column("seconds", sa.Double, nullable=False),
    # Of their artifacts.
    sa.Column("bytes", sa.BigInteger, nullable=False),
)

# Keys shared by all API processes, such as the one for signed URLs.
secrets = sa.Table(
    "secrets",
    metadata,
    sa.Column("name", sa.String(64), primary_key=True),
    sa.Column("value", sa.String(128), nullable=False),
)

# Prefixes of objects of deleted jobs, until they are removed from the store.
discarded = sa.Table("discarded", metadata, sa.Column("prefix", sa.String(255), primary_key=True))
READ_ONLY_SERVER = "25006"
"""The code of a write to a standby, or to a primary that an operator has set to read-only."""


def compatible(version: str | None) -> bool:
    """Return whether this version of Meshdeform can use a record with that schema as it is."""
    return version is not None and version[:2] == HEAD[:2] and version >= HEAD


def sql_state(error: BaseException | None) -> str:
    """Return the code of an error of the driver; empty if it has none."""
    state = error.args[0] if error is not None and error.args else None
    return str(state.get("C", "")) if isinstance(state, dict) else ""
