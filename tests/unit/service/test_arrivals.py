"""Files that a request names by URL, as they come."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from service.jobs.arrivals import arriving
from service.jobs.documents import JobDocument
from service.jobs.intake import Submission
from service.state import AppState


class _SlowToEnd:
    """Places for fetches, in which one that is given up needs a while to end."""

    wait_s = 1.0

    def __init__(self) -> None:
        self.ended = 0

    @contextlib.asynccontextmanager
    async def slot(self, *_: Any, **__: Any) -> AsyncIterator[None]:
        try:
            await asyncio.Event().wait()
            yield
        finally:
            for _turn in range(10):
                await asyncio.sleep(0)
            self.ended += 1


def test_what_is_given_up_has_ended_before_its_folder_goes(tmp_path: Path) -> None:
    fetches = _SlowToEnd()
    app = cast("AppState", SimpleNamespace(settings=SimpleNamespace(fetch_assets=True), fetches=fetches))
    sources = {name: {"url": f"https://example.com/{name}.glb"} for name in ("asset", "target")}
    document = JobDocument.model_validate({"files": sources})

    async def leave_early() -> None:
        async with arriving(app, "owner", Submission(document, {}, tmp_path)):
            await asyncio.sleep(0)  # the fetches begin

    asyncio.run(leave_early())
    assert fetches.ended == 2
