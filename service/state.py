"""What the routes work with: made once when the application starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from anyio import CapacityLimiter
from fastapi import Depends, Request

from meshdeform.assets import Limits
from meshdeform.assets.check import CheckedAssets
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from service.events.broker import JobWaiters

__all__ = ["AppState", "AppStateDep"]

_INTAKES_AT_ONCE = 2
_BODIES_AT_ONCE = 16


@dataclass(frozen=True)
class AppState:
    """The parts of the service.

    Attributes
    ----------
    settings : Settings
    record : JobRecord
    queue : JobQueue
    store : ObjectStore
    waiters : JobWaiters
        Who waits for a job.
    assets : CheckedAssets
        What is known of files.
    intake : CapacityLimiter
        Threads that check and store uploads. They are apart from those that answer the other requests, which so
        never wait for a decoder.
    bodies : CapacityLimiter
        Files that are received at the same time; each may take its size on the disk.
    """

    settings: Settings
    record: JobRecord
    queue: JobQueue
    store: ObjectStore
    waiters: JobWaiters
    assets: CheckedAssets
    intake: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_INTAKES_AT_ONCE))
    bodies: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_BODIES_AT_ONCE))

    @classmethod
    def open(cls, settings: Settings) -> AppState:
        """Open what the settings name.

        Raises
        ------
        UnavailableError, DependencyError
            A part cannot be opened. Redis may be away: nothing is asked of it here.
        """
        record = JobRecord(settings.resolved_database_url)
        return cls(
            settings=settings,
            record=record,
            queue=JobQueue(settings.redis_url, settings.queue),
            store=ObjectStore(settings.resolved_storage_url, public_url=settings.storage_public_url),
            waiters=JobWaiters(record.events.heads),
            assets=CheckedAssets(Limits.from_settings(settings)),
        )

    def close(self) -> None:
        """Give the connections back."""
        self.queue.close()
        self.record.close()


def _app_state(request: Request) -> AppState:
    app: AppState = request.app.state.app_state
    return app


AppStateDep = Annotated[AppState, Depends(_app_state)]
