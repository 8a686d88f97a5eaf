"""Ask a service for previews as many people do, beside jobs: ``python -m bench.preview_load [--people 5] [--every 3]``.

Starts a service with one worker, and posts jobs one after the other, first alone and then while people, each an owner
with a key, type one prompt after the other for the painted animal with 10,000 faces, as the page asks: a draft, the
exact shape, drafts of six designs, until the next is typed. `--people 5 --every 3`: as five type; `--people 40 --every
15`: as 40 try something now and then. One of them also drags a slider. Prints the p50 and p95 of the first shapes and
of plain changes, what was answered, and how much longer the jobs took beside them. Nouns are drawn and the asset is
read before.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import hashlib
import json
import random
import tempfile
import time
from collections import Counter
from pathlib import Path
from statistics import median

import httpx
import numpy as np

from bench.live import PROMPTS, asset_of, import_torch, service
from meshdeform.api.states import JobState
from meshdeform.reading.banks import bank_of
from meshdeform.record.database import Database
from meshdeform.record.keys import KeyRing
from meshdeform.runs.kept_readings import samples_in
from meshdeform.settings import Settings

FACES, TIMEOUT_S, DESIGNS = 10_000, 300.0, 6


def key_of(folder: Path, owner: str) -> str:
    """Return a new key of an owner in the data directory of a service."""
    database = Database(Settings(data_dir=folder).resolved_database_url)
    try:
        return KeyRing(database).create(owner, requests_per_minute=0)[1]
    finally:
        database.close()


class Load:
    """People and jobs of one service, and how long they waited."""

    def __init__(self, url: str, asset: bytes) -> None:
        self._url, self._asset = url, asset
        self._kept = {"sha256": hashlib.sha256(asset).hexdigest()}
        self.previews: list[float] = []
        self.changes: list[float] = []
        self.answers: Counter[int] = Counter()

    def client(self, key: str) -> httpx.AsyncClient:
        """Return a client with a key."""
        return httpx.AsyncClient(base_url=self._url, timeout=TIMEOUT_S, headers={"Authorization": f"Bearer {key}"})

    async def person(self, key: str, every_s: float, until: float) -> None:
        """Type prompts, so many seconds apart in the mean, until a time; the next one ends what follows a draft."""
        async with self.client(key) as http:
            while time.monotonic() < until:
                pause_s = every_s * random.uniform(0.5, 1.5)
                prompt, begun = random.choice(PROMPTS), time.perf_counter()
                if await self._ask(http, prompt, 0, "glb", draft=True) == 200:
                    self.previews.append(time.perf_counter() - begun)
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(self._follow(http, prompt), begun + pause_s - time.perf_counter())
                await asyncio.sleep(begun + pause_s - time.perf_counter())

    async def read(self, key: str) -> None:
        """Let the service read the asset for an owner."""
        async with self.client(key) as http:
            sent = self._upload("longer legs")
            while (answer := await http.post("/v1/jobs:preview", files=sent)).status_code in (429, 503):
                await asyncio.sleep(1)  # whoever else reads it
            answer.raise_for_status()

    def _upload(self, prompt: str) -> dict[str, tuple[str | None, bytes | str]]:
        """Return the parts of a form with the asset and a request."""
        return {"asset": ("animal.glb", self._asset), "request": (None, json.dumps({"prompt": prompt}))}

    async def _follow(self, http: httpx.AsyncClient, prompt: str) -> None:
        """Ask for what the page shows after a draft: the exact shape, and other designs."""
        await self._ask(http, prompt, 0, "glb", draft=False)
        for seed in range(DESIGNS):
            await self._ask(http, prompt, seed, "positions", draft=True)

    async def _ask(self, http: httpx.AsyncClient, prompt: str, seed: int, form: str, *, draft: bool) -> int:
        """Ask for a preview, and return the status of the answer."""
        query = {"as": form, "draft": str(draft).lower()}
        document = {"asset": self._kept, "prompt": prompt, "seeds": [seed]}
        answer = await http.post("/v1/jobs:preview", params=query, json=document)
        self.answers[answer.status_code] += 1
        return answer.status_code

    async def change(self, key: str, until: float) -> None:
        """Drag a slider now and then: plain changes, which are not to wait for fits."""
        async with self.client(key) as http:
            while time.monotonic() < until:
                await asyncio.sleep(1.0)
                begun, prompt = time.perf_counter(), f"legs longer by {random.randint(5, 60)} %"
                if await self._ask(http, prompt, 0, "positions", draft=False) == 200:
                    self.changes.append(time.perf_counter() - begun)

    async def jobs(self, key: str, until: float) -> list[float]:
        """Run one job after the other until a time, and return the seconds of each."""
        found: list[float] = []
        async with self.client(key) as http:
            while time.monotonic() < until or not found:
                begun = time.perf_counter()
                answer = await http.post("/v1/jobs", files=self._upload(PROMPTS[0]))
                answer.raise_for_status()
                path = f"/v1/jobs/{answer.json()['id']}"
                while not (state := JobState((await http.get(path)).json()["state"])).terminal:
                    await asyncio.sleep(0.02)
                if state is not JobState.SUCCEEDED:
                    raise SystemExit(f"a job is {state}")
                found.append(time.perf_counter() - begun)
        return found

    async def together(self, keys: list[str], every_s: float, seconds: float) -> list[float]:
        """Let people ask and jobs run for so many seconds; return the seconds of the jobs."""
        await asyncio.gather(*map(self.read, keys[1:]))
        until = time.monotonic() + seconds
        people = (self.person(key, every_s, until) for key in keys[1:])
        others = asyncio.gather(self.change(keys[1], until), *people)
        found, _ = await asyncio.gather(self.jobs(keys[0], until), others)
        return found


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=5)
    parser.add_argument("--every", type=float, default=3.0, help="mean seconds between two previews of a person")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    asset = asset_of(FACES)
    for prompt in PROMPTS:
        bank_of(prompt.split()[1], samples_in(Settings().cache_folder), ())
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        with service(data):  # which makes its database
            keys = [key_of(data, f"owner-{number}") for number in range(options.people + 1)]
        with service(data, MESHDEFORM_AUTH="on") as url:
            load = Load(url, asset)
            asyncio.run(load.jobs(keys[0], 0))
            alone = asyncio.run(load.jobs(keys[0], time.monotonic() + options.seconds / 3))
            beside = asyncio.run(load.together(keys, options.every, options.seconds))
    for what, seconds in (("first shapes", load.previews), ("changes", load.changes)):
        if seconds:
            p50, p95 = np.percentile(seconds, (50, 95))
            print(f"{what}: {len(seconds)}, p50 {p50:.2f} s, p95 {p95:.2f} s", flush=True)
        else:
            print(f"{what}: none", flush=True)
    print(f"answers {dict(load.answers)}")
    print(
        f"jobs: alone {median(alone):.2f} s, beside {median(beside):.2f} s, {median(beside) / median(alone):.2f} times"
    )
    print(f"import torch: {import_torch()[0]:.2f} s")


if __name__ == "__main__":
    main()
