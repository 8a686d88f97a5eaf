"""How workers are told: a message on an RQ queue that a job waits, and a cancel over Redis' publish and subscribe.

Redis is not the record. What it loses, the reconciler tells it again; what it delivers twice, `Leases.claim_next` gives
to one worker only.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager

from redis import Redis
from redis.backoff import NoBackoff
from redis.client import PubSub
from redis.exceptions import RedisError
from redis.retry import Retry
from rq import Queue
from rq.serializers import JSONSerializer

from meshdeform.errors import DependencyError, UnavailableError

__all__ = ["CancelSubscription", "JobQueue", "job_of"]

_MESSAGE = "a job waits"
"""What RQ calls the function of a message. Nobody calls it: whoever reads a message takes the most urgent job."""
_log = logging.getLogger(__name__)


class JobQueue:
    """One RQ queue.

    Parameters
    ----------
    redis_url : str
    name : str
        The queue's name.

    Raises
    ------
    DependencyError
        The URL is not one of a Redis.
    """

    def __init__(self, redis_url: str, name: str) -> None:
        try:
            # One more try at once, for a connection that Redis closed meanwhile; whoever waits longer than that is the
            # reconciler.
            self._redis = Redis.from_url(
                redis_url, socket_connect_timeout=2, socket_timeout=5, retry=Retry(NoBackoff(), 1)
            )
        except ValueError as error:
            raise DependencyError(
                "MESHDEFORM_REDIS_URL is no Redis URL.", advice="Write redis://host:6379/0, or unix:///path/to/socket."
            ) from error
        self._queue = Queue(name, connection=self._redis, serializer=JSONSerializer)

    def close(self) -> None:
        """Give the connections back."""
        self._redis.close()

    def ping(self) -> None:
        """Ask Redis for a sign of life.

        Raises
        ------
        UnavailableError
            There is none.
        """
        with _redis_errors():
            self._redis.ping()

    def enqueue(self, job_id: str) -> None:
        """Tell the workers that a job waits. The message holds nothing but its name: the job's id and a number.

        Raises
        ------
        UnavailableError
            Redis does not answer. The reconciler will tell later.
        """
        with _redis_errors():
            self._queue.enqueue(
                _MESSAGE, job_id=f"{job_id}-{time.time_ns()}", job_timeout=-1, result_ttl=0, failure_ttl=60
            )

    def told(self) -> set[str]:
        """The ids of the jobs that wait in Redis."""
        with _redis_errors():
            return {job_of(entry) for entry in self._queue.get_job_ids()}

    def length(self) -> int:
        """How many messages wait in Redis."""
        with _redis_errors():
            return int(self._queue.count)

    def publish_cancel(self, job_id: str) -> None:
        """Tell whoever runs the job to stop; the record says so too, so losing this only costs time."""
        with _redis_errors():
            self._redis.publish(_channel(job_id), "cancel")

    @contextmanager
    def listen_for_cancel(self, job_id: str) -> Iterator[CancelSubscription]:
        """Hear `publish_cancel` for one job, for the length of a `with` block."""
        subscription = CancelSubscription(self._redis, _channel(job_id))
        try:
            yield subscription
        finally:
            subscription.close()


class CancelSubscription:
    """A subscription that survives a Redis that goes away and comes back."""

    def __init__(self, redis: Redis, channel: str) -> None:
        self._redis, self._channel = redis, channel
        self._pubsub: PubSub | None = None

    def wait(self, timeout_s: float) -> bool:
        """True when a cancel was heard; False when `timeout_s` seconds went by. Never raises."""
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
        except RedisError as error:
            _log.warning("the cancel channel does not answer (%s); the record will tell", type(error).__name__)
            self.close()
            time.sleep(max(0.0, end - time.monotonic()))
        return False

    def close(self) -> None:
        """End the subscription."""
        if self._pubsub is not None:
            try:
                self._pubsub.close()
            except RedisError:
                _log.debug("the subscription was gone already")
        self._pubsub = None


def job_of(message: str) -> str:
    """Return the id of the job that a message, by its name, was sent for."""
    return message.rpartition("-")[0]


def _channel(job_id: str) -> str:
    return f"meshdeform:cancel:{job_id}"


@contextmanager
def _redis_errors() -> Iterator[None]:
    try:
        yield
    except RedisError as error:
        raise UnavailableError(f"Redis does not answer ({type(error).__name__}).") from error
