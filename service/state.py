"""Hold the objects that all routes share, created when the application starts."""

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
from meshdeform.webhooks.lookups import LookupPool
from service.events.broker import JobWaiters

__all__ = ["AppState", "AppStateDep"]

_INTAKES_AT_ONCE = 2
_BODIES_AT_ONCE = 16
_LOOKUPS_AT_ONCE = 16


@dataclass(frozen=True)
class AppState:
    """The shared objects of the service.

    Attributes
    ----------
    settings : Settings
    record : JobRecord
    queue : JobQueue
    store : ObjectStore
    waiters : JobWaiters
        Requests that wait for jobs.
    assets : CheckedAssets
        Results of checks of assets.
    intake : CapacityLimiter
        Threads that check and store assets, separate from those of other requests.
    bodies : CapacityLimiter
        Files that may be received at the same time. Each takes its size on disk.
    lookups : LookupPool
        Threads that resolve the hosts of webhooks.
    """

    settings: Settings
    record: JobRecord
    queue: JobQueue
    store: ObjectStore
    waiters: JobWaiters
    assets: CheckedAssets
    intake: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_INTAKES_AT_ONCE))
    bodies: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_BODIES_AT_ONCE))
    lookups: LookupPool = field(default_factory=lambda: LookupPool(_LOOKUPS_AT_ONCE, share=_LOOKUPS_AT_ONCE // 4))

    @classmethod
    def open(cls, settings: Settings) -> AppState:
        """Open the connections that the settings describe.

        Raises
        ------
        UnavailableError, DependencyError
            A connection cannot be opened. Redis may be unavailable: it is not contacted here.
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
        """Close the connections."""
        self.queue.close()
        self.record.close()


def _app_state(request: Request) -> AppState:
    app: AppState = request.app.state.app_state
    return app


AppStateDep = Annotated[AppState, Depends(_app_state)]
