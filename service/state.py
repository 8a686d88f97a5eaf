"""Hold the objects that all routes share, created when the application starts."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Annotated, TypeVar, TypeVarTuple

from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Request

from meshdeform.assets import Limits
from meshdeform.assets.check import CheckedAssets
from meshdeform.children.warm import WarmProcesses
from meshdeform.errors import MeshdeformError
from meshdeform.outgoing.lookups import LookupPool
from meshdeform.record.database import HASTY, MAX_CONNECTIONS
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.runs.kept_readings import samples_in
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from meshdeform.storage.readings import StoredReadings
from service.downloads.variants import Variants
from service.events.waiting import JobWaiters
from service.http.limits import FairSlots
from service.jobs.kept_assets import KeptAssets
from service.schemas import PartHealth
from service.workspace import Workspace

# One more than an owner may have: nobody waits for the files of one other owner.
_CHECKS_AT_ONCE, _CHECKS_PER_OWNER, _CHECK_WAIT_S = 3, 2, 120.0
_BODIES_AT_ONCE, _BODIES_PER_OWNER, _BODY_WAIT_S = 16, 8, 20.0
# Of one owner so few that those of three slow ones leave room for others.
_FETCHES_AT_ONCE, _FETCHES_PER_OWNER, _FETCH_WAIT_S = 16, 4, 120.0
_PROCESSES_AT_ONCE, _PROCESSES_PER_OWNER = 2, 1
_LOOKUPS_AT_ONCE = 16
_PREVIEWERS, _PREVIEWS_IDLE_S = 12, 600.0
"""An owner may have two: one fits, the other makes plain changes."""
_STORE_HEALTH_S = 2.0
_BACKGROUND = 4
"""Of the connections to PostgreSQL, those for the reconciler and for webhooks."""


_Result = TypeVar("_Result")
_Arguments = TypeVarTuple("_Arguments")


class Probe:
    """Asks a service of the deployment whether it answers, in a thread of its own: one that hangs holds up nobody else.

    An answer is kept for some seconds. Thread-safe.
    """

    def __init__(self, kept_s: float = 0.0) -> None:
        self._kept_s = kept_s
        self._answer: Future[PartHealth] | None = None
        self._until = 0.0
        self._lock = threading.Lock()

    def ask(self, ping: Callable[[], None]) -> Future[PartHealth]:
        """Return the answer that is kept or awaited, or ask again; `ping` raises `MeshdeformError` in an outage."""
        with self._lock:
            if self._answer is None or (self._answer.done() and time.monotonic() >= self._until):
                self._answer = Future()
                threading.Thread(target=self._run, args=(self._answer, ping), name="probe", daemon=True).start()
            return self._answer

    def _run(self, answer: Future[PartHealth], ping: Callable[[], None]) -> None:
        try:
            ping()
            health = PartHealth(status="ok")
        except MeshdeformError as error:
            health = PartHealth(status="unavailable", detail=error.detail)
        except BaseException as error:
            answer.set_exception(error)
            return
        self._until = time.monotonic() + self._kept_s
        answer.set_result(health)


def _processes(purpose: str) -> Callable[[], FairSlots]:
    """Make the slots of what takes a process of its own."""
    return lambda: FairSlots(_PROCESSES_AT_ONCE, _PROCESSES_PER_OWNER, wait_s=_CHECK_WAIT_S, purpose=purpose)


def _lookups() -> LookupPool:
    return LookupPool(_LOOKUPS_AT_ONCE, share=_LOOKUPS_AT_ONCE // 4)


@dataclass(frozen=True)
class AppState:
    """The shared objects of the service."""

    settings: Settings
    record: JobRecord  # for requests: it does not wait long for its database
    background: JobRecord  # for tasks that nobody waits for
    queue: JobQueue
    store: ObjectStore
    waiters: JobWaiters
    assets: CheckedAssets
    workspace: Workspace
    variants: Variants
    readings: StoredReadings
    kept_assets: KeptAssets
    previews: WarmProcesses = field(
        default_factory=lambda: WarmProcesses("preview", most=_PREVIEWERS, idle_s=_PREVIEWS_IDLE_S)
    )
    # Requests whose files are checked and stored at the same time, in threads: others never wait for a decoder.
    intake: FairSlots = field(
        default_factory=lambda: FairSlots(
            _CHECKS_AT_ONCE, _CHECKS_PER_OWNER, wait_s=_CHECK_WAIT_S, purpose="files are being checked"
        )
    )
    # Files that are received at the same time. Each takes its size on disk.
    bodies: FairSlots = field(
        default_factory=lambda: FairSlots(
            _BODIES_AT_ONCE, _BODIES_PER_OWNER, wait_s=_BODY_WAIT_S, purpose="files are being received"
        )
    )
    # Files that are fetched from URLs at the same time.
    fetches: FairSlots = field(
        default_factory=lambda: FairSlots(
            _FETCHES_AT_ONCE, _FETCHES_PER_OWNER, wait_s=_FETCH_WAIT_S, purpose="files are being fetched"
        )
    )
    # Jobs whose files are still being fetched after they were accepted.
    late: set[asyncio.Task[None]] = field(default_factory=set)
    # What `/readyz` asks. The answer of the object store is kept, because it lists a bucket, and nobody needs a key.
    record_health: Probe = field(default_factory=Probe)
    redis_health: Probe = field(default_factory=Probe)
    store_health: Probe = field(default_factory=lambda: Probe(_STORE_HEALTH_S))
    # Searches of parts and previews, words, and what kinds of job do besides: each in a process.
    naming: FairSlots = field(default_factory=_processes("parts are being found or previews made"))
    # Previews of plain changes: a moment's work never waits for the fits of others.
    changing: FairSlots = field(default_factory=_processes("previews of changes are made"))
    wording: FairSlots = field(default_factory=_processes("words are being made"))
    # Threads that resolve the hosts of webhooks and of files; neither waits for the other.
    webhook_lookups: LookupPool = field(default_factory=_lookups)
    fetch_lookups: LookupPool = field(default_factory=_lookups)
    _of_kinds: dict[str, FairSlots] = field(default_factory=dict)
    _intake_threads: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(_CHECKS_AT_ONCE))

    def slots_for(self, purpose: str) -> FairSlots:
        """Return the slots of what a kind of job does in a process of its own: "drawings are being read"."""
        if purpose not in self._of_kinds:
            self._of_kinds[purpose] = _processes(purpose)()
        return self._of_kinds[purpose]

    @classmethod
    def open(cls, settings: Settings, *, alone: bool = False) -> AppState:
        """Open the connections that the settings describe.

        `alone`: whether the process is a server and nothing else: what it needs once is then done in another one.
        """
        url = settings.resolved_database_url
        record = JobRecord(url, MAX_CONNECTIONS - _BACKGROUND, upgrade_elsewhere=alone, patience=HASTY)
        location, public_url = settings.resolved_storage_url, settings.storage_public_url
        store = ObjectStore(location, public_url=public_url, create=not record.files.any())
        workspace, limits = Workspace(), Limits.from_settings(settings)
        return cls(
            settings=settings,
            record=record,
            background=JobRecord(url, _BACKGROUND),
            queue=JobQueue(settings.redis_url, settings.queue),
            store=store,
            waiters=JobWaiters(record.events.heads),
            assets=CheckedAssets(limits),
            workspace=workspace,
            variants=Variants(record, store, workspace, limits),
            readings=StoredReadings(store, samples_in(settings.cache_folder)),
            kept_assets=KeptAssets(workspace.folder / "kept"),
        )

    async def take_in(self, owner_id: str, work: Callable[[*_Arguments], _Result], *arguments: *_Arguments) -> _Result:
        """Check or store files in a thread, when it is the owner's turn; `UnavailableError`: that takes too long."""
        async with self.intake.slot(owner_id):
            return await to_thread.run_sync(work, *arguments, limiter=self._intake_threads)

    def close(self) -> None:
        """End the processes of previews, remove the temporary folders and close the connections."""
        self.previews.close()
        self.workspace.close()
        self.queue.close()
        self.record.close()
        self.background.close()


async def _app_state(request: Request) -> AppState:  # not `def`: FastAPI would call that in a thread
    app: AppState = request.app.state.app_state
    return app


AppStateDep = Annotated[AppState, Depends(_app_state)]
