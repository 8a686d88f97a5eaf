"""What the routes work with: made once when the application starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from anyio import CapacityLimiter
from fastapi import Depends, Request

from meshdeform.jobs.queue import JobQueue
from meshdeform.jobs.record import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore

__all__ = ["Parts", "PartsDep"]

_INTAKES_AT_ONCE = 2


@dataclass(frozen=True)
class Parts:
    """The parts of the service.

    Attributes
    ----------
    settings : Settings
    record : JobRecord
    queue : JobQueue
    store : ObjectStore
    intake : CapacityLimiter
        Threads that check and store uploads. They are apart from those that answer the other requests, which so
        never wait for a decoder.
    """

    settings: Settings
    record: JobRecord
    queue: JobQueue
    store: ObjectStore
    intake: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_INTAKES_AT_ONCE))

    @classmethod
    def open(cls, settings: Settings) -> Parts:
        """Open what the settings name.

        Raises
        ------
        UnavailableError, DependencyError
            A part cannot be opened. Redis may be away: nothing is asked of it here.
        """
        return cls(
            settings=settings,
            record=JobRecord(settings.resolved_database_url),
            queue=JobQueue(settings.redis_url, settings.queue),
            store=ObjectStore(settings.resolved_storage_url),
        )

    def close(self) -> None:
        """Give the connections back."""
        self.queue.close()
        self.record.close()


def _parts(request: Request) -> Parts:
    parts: Parts = request.app.state.parts
    return parts


PartsDep = Annotated[Parts, Depends(_parts)]
