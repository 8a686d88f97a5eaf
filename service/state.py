"""What the routes work with: made once when the application starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, TypeVar, TypeVarTuple

from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Request

from meshdeform.assets import Limits
from meshdeform.assets.check import CheckedAssets
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from service.events.broker import JobWaiters
from service.http.slots import FairSlots
from service.workspace import Workspace

__all__ = ["AppState", "AppStateDep"]

# One more than an owner may have: nobody waits for the files of one other owner.
_CHECKS_AT_ONCE, _CHECKS_PER_OWNER, _CHECK_WAIT_S = 3, 2, 120.0
_BODIES_AT_ONCE, _BODIES_PER_OWNER, _BODY_WAIT_S = 16, 8, 20.0

_Result = TypeVar("_Result")
_Arguments = TypeVarTuple("_Arguments")


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
        Files that passed the check.
    workspace : Workspace
        Temporary folders for the files of requests.
    intake : FairSlots
        Requests whose files are checked and stored at the same time, in threads of their own: other requests never
        wait for a decoder.
    bodies : FairSlots
        Files that are received at the same time; each may take its size on the disk.
    """

    settings: Settings
    record: JobRecord
    queue: JobQueue
    store: ObjectStore
    waiters: JobWaiters
    assets: CheckedAssets
    workspace: Workspace
    intake: FairSlots = field(
        default_factory=lambda: FairSlots(
            _CHECKS_AT_ONCE, _CHECKS_PER_OWNER, wait_s=_CHECK_WAIT_S, purpose="files are being checked"
        )
    )
    bodies: FairSlots = field(
        default_factory=lambda: FairSlots(
            _BODIES_AT_ONCE, _BODIES_PER_OWNER, wait_s=_BODY_WAIT_S, purpose="files are being received"
        )
    )
    _intake_threads: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_CHECKS_AT_ONCE))

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
            workspace=Workspace(),
        )

    async def take_in(self, owner_id: str, work: Callable[[*_Arguments], _Result], *arguments: *_Arguments) -> _Result:
        """Check or store files in a thread, when it is the owner's turn.

        Raises
        ------
        UnavailableError
            No slot of `intake` became free in time.
        """
        async with self.intake.slot(owner_id):
            return await to_thread.run_sync(work, *arguments, limiter=self._intake_threads)

    def close(self) -> None:
        """Remove the temporary folders and close the connections."""
        self.workspace.close()
        self.queue.close()
        self.record.close()


def _app_state(request: Request) -> AppState:
    app: AppState = request.app.state.app_state
    return app


AppStateDep = Annotated[AppState, Depends(_app_state)]
