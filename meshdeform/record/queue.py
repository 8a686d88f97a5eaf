"""Notify workers through Redis: of queued jobs by messages on an RQ queue, of cancellations by publish and subscribe.

Redis is not the record. The reconciler repeats lost messages, and `Leases.claim_next` gives each job to one worker,
however often it is announced.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager

from redis import Redis
from redis.backoff import NoBackoff
from redis.client import PubSub
from redis.exceptions import ConnectionError as RedisConnectionError
from redis.exceptions import RedisError
from redis.exceptions import TimeoutError as RedisTimeoutError
from redis.retry import Retry
from rq import Queue
from rq.serializers import JSONSerializer

from meshdeform.errors import DependencyError, UnavailableError

REDIS_AWAY = RedisError
"""What counts as an outage of Redis: it does not answer, or refuses, as one that is full, loading, or a replica does.

Whoever talks to Redis must go on without it after any of these, by asking the record.
"""

MESSAGE = "a job waits"
"""The function name that RQ stores in a message. It is never called: the reader of a message claims the next job."""
_SILENT = (RedisConnectionError, RedisTimeoutError)
_log = logging.getLogger(__name__)


class JobQueue:
    """One RQ queue. `DependencyError`: the URL is not a Redis URL."""

    def __init__(self, redis_url: str, name: str) -> None:
        self.name = name
        try:
            # Retry once at once, in case Redis closed the connection; the reconciler handles longer outages.
            self._redis = Redis.from_url(
                redis_url, socket_connect_timeout=2, socket_timeout=5, retry=Retry(NoBackoff(), 1)
            )
        except ValueError as error:
            raise DependencyError(
                "MESHDEFORM_REDIS_URL is no Redis URL.", advice="Write redis://host:6379/0, or unix:///path/to/socket."
            ) from error
        self._queue = Queue(name, connection=self._redis, serializer=JSONSerializer)

    def close(self) -> None:
        """Close the connections."""
        self._redis.close()

    def ping(self) -> None:
        """Check that Redis takes messages; `UnavailableError`: it does not answer, or refuses."""
        # The first command of `enqueue`, and no PING, which those answer that refuse to write. It changes nothing.
        with _redis_errors():
            self._redis.sadd(Queue.redis_queues_keys, self._queue.key)

    def enqueue(self, job_id: str) -> None:
        """Announce a queued job to the workers. The message has only a name: the job's id and a number.

        If Redis is away (`UnavailableError`), the reconciler will announce the job later.
        """
        name = f"{job_id}-{time.time_ns()}"
        message = self._queue.create_job(MESSAGE, job_id=name, timeout=-1, result_ttl=0, failure_ttl=60)
        message.enqueued_at = message.created_at
        # As `Queue.enqueue` does, which needs two round trips and eight commands for it.
        with self._queue_errors(), self._redis.pipeline() as pipeline:
            pipeline.sadd(Queue.redis_queues_keys, self._queue.key)
            message.save(pipeline=pipeline)
            self._queue.push_job_id(name, pipeline=pipeline)
            pipeline.execute()

    def announced(self) -> set[str]:
        """Return the ids of the jobs with a message in Redis."""
        with self._queue_errors():
            return {job_of(entry) for entry in self._queue.get_job_ids()}

    def length(self) -> int:
        """Return the number of messages in Redis."""
        with self._queue_errors():
            return int(self._queue.count)

    @contextmanager
    def _queue_errors(self) -> Iterator[None]:
        """Delete a value in the queue's place that is no list; the reconciler then announces the jobs again."""
        try:
            with _redis_errors():
                yield
        except UnavailableError as error:
            if "WRONGTYPE" in str(error.__cause__):
                _log.error("the key %s in Redis is no list, and is deleted", self._queue.key)
                with _redis_errors():
                    self._redis.delete(self._queue.key)
            raise

    def publish_cancel(self, job_id: str) -> None:
        """Notify the worker that runs the job of its cancellation; if the message is lost, the record still says so."""
        with _redis_errors():
            self._redis.publish(_channel(job_id), "cancel")

    @contextmanager
    def listen_for_cancel(self, job_id: str) -> Iterator[CancelSubscription]:
        """Subscribe to `publish_cancel` for one job, for the duration of a `with` block."""
        subscription = CancelSubscription(self._redis, _channel(job_id))
        try:
            yield subscription
        finally:
            subscription.close()


class CancelSubscription:
    """A subscription that survives an outage of Redis."""

    def __init__(self, redis: Redis, channel: str) -> None:
        self._redis, self._channel = redis, channel
        self._pubsub: PubSub | None = None

    def wait(self, timeout_s: float) -> bool:
        """Return True when a message arrives; False after `timeout_s` seconds. Never raises.

        Anybody with access to Redis can send one, so it is only a hint to ask the record.
        """
        end = time.monotonic() + timeout_s
        try:
            if self._pubsub is None:
                pubsub = self._redis.pubsub(ignore_subscribe_messages=True)  # type: ignore[no-untyped-call]
                pubsub.subscribe(self._channel)
                self._pubsub = pubsub
            while (left := end - time.monotonic()) > 0:
                message = self._pubsub.get_message(timeout=left)
                if message is not None and message["type"] == "message":
                    return True
        except REDIS_AWAY as error:
            _log.warning("no cancel channel (%s); the next heartbeat will ask the record", type(error).__name__)
            self.close()
            time.sleep(max(0.0, end - time.monotonic()))
        return False

    def close(self) -> None:
        """End the subscription."""
        if self._pubsub is not None:
            try:
                self._pubsub.close()
            except REDIS_AWAY:
                _log.debug("the subscription was gone already")
        self._pubsub = None


def job_of(message: str) -> str:
    """Return the job id contained in the name of a message."""
    return message.rpartition("-")[0]


def _channel(job_id: str) -> str:
    return f"meshdeform:cancel:{job_id}"


@contextmanager
def _redis_errors() -> Iterator[None]:
    try:
        yield
    except REDIS_AWAY as error:
        says = "does not answer" if isinstance(error, _SILENT) else "refuses"
        raise UnavailableError(f"Redis {says} ({type(error).__name__}).") from error
