"""What the routes work with: made once when the application starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import BoundedSemaphore
from typing import Annotated

from fastapi import Depends, Request

from meshdeform.jobs.queue import JobQueue
from meshdeform.jobs.record import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore

__all__ = ["Parts", "PartsDep"]

_CHECKS_AT_ONCE = 2


@dataclass(frozen=True)
class Parts:
    """The parts of the service.

    Attributes
    ----------
    settings : Settings
    record : JobRecord
    queue : JobQueue
    store : ObjectStore
    checking : BoundedSemaphore
        Held while an asset is decoded: so many children at once, however many requests there are.
    """

    settings: Settings
    record: JobRecord
    queue: JobQueue
    store: ObjectStore
    checking: BoundedSemaphore = field(default_factory=lambda: BoundedSemaphore(_CHECKS_AT_ONCE))

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
