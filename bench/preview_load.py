"""Ask a service for previews as many people do, beside jobs: ``python -m bench.preview_load [--people 5] [--every 3]``.

Starts a service with one worker, and posts jobs one after the other, first alone and then while people, each an owner
with a key, type one prompt after the other for the painted animal with 10,000 faces: `--people 5 --every 3` as five
type, `--people 40 --every 15` as 40 try something now and then. Each prompt asks for what the page does: a draft, then
six designs, then the exact shape, until the next prompt. Prints the p50 and p95 of the time to each, of first shapes
also that of prompts that the next one overtook, what was answered, and how much longer the jobs took. Nouns are drawn
and the asset is read before.
"""

from __future__ import annotations

import argparse
import asyncio
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
from meshdeform.api.states import MAX_PREVIEWED, JobState
from meshdeform.reading.banks import bank_of
from meshdeform.record.database import Database
from meshdeform.record.keys import KeyRing
from meshdeform.runs.kept_readings import samples_in
from meshdeform.settings import Settings

FACES, TIMEOUT_S, MOMENT_S = 10_000, 300.0, 0.5
OTHERS = ("cat", "bear", "fox", "wolf", "deer", "goat", "donkey", "hippo", "tiger")
TYPED = (*PROMPTS, *(f"a {noun}" for noun in OTHERS))


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
        self.first: list[float] = []
        self.six: list[float] = []
        self.exact: list[float] = []
        self.answers: Counter[int] = Counter()
        self.overtaken = 0

    def client(self, key: str) -> httpx.AsyncClient:
        """Return a client with a key."""
        return httpx.AsyncClient(base_url=self._url, timeout=TIMEOUT_S, headers={"Authorization": f"Bearer {key}"})

    async def prepare(self, key: str) -> None:
        """Let a person's process read the asset."""
        sent = {"asset": ("animal.glb", self._asset), "request": (None, json.dumps({"prompt": "longer legs"}))}
        async with self.client(key) as http:
            while (answer := await http.post("/v1/jobs:preview", files=sent)).status_code == 503:
                pass  # reading it took too long, and is gone on with
            answer.raise_for_status()

    async def person(self, key: str, every_s: float, until: float) -> None:
        """Type prompts, so many seconds apart in the mean, until a time; the next one ends what the last asked."""
        prompts: list[str] = []
        async with self.client(key) as http:
            await asyncio.sleep(every_s * random.random())
            while time.monotonic() < until:
                prompts = prompts or random.sample(TYPED, len(TYPED))  # what was seen is remembered
                looking = asyncio.create_task(self.look(http, prompts.pop()))
                await asyncio.wait((looking,), timeout=max(every_s * random.uniform(0.5, 1.5), MOMENT_S))
                looking.cancel()
                await asyncio.wait((looking,))

    async def look(self, http: httpx.AsyncClient, prompt: str) -> None:
        """Ask for what the page does: a draft, six designs, then the exact shape; again after a refusal."""
        begun, seen = time.perf_counter(), False
        try:
            while not await self.ask(http, prompt, 0, "glb", draft=True):
                pass
            self.first.append(time.perf_counter() - begun)
            seen = True
            for seed in range(MAX_PREVIEWED):
                while not await self.ask(http, prompt, seed, "positions", draft=True):
                    pass
            self.six.append(time.perf_counter() - begun)
            while not await self.ask(http, prompt, 0, "glb", draft=False):
                pass
            self.exact.append(time.perf_counter() - begun)
        finally:
            if not seen:
                self.first.append(time.perf_counter() - begun)
                self.overtaken += 1

    async def ask(self, http: httpx.AsyncClient, prompt: str, seed: int, form: str, *, draft: bool) -> bool:
        """Return whether an answer came; wait as long as a refusal says."""
        document = {"asset": self._kept, "prompt": prompt, "seeds": [seed]}
        query = {"as": form, "draft": str(draft).lower()}
        answer = await http.post("/v1/jobs:preview", json=document, params=query)
        self.answers[answer.status_code] += 1
        if answer.status_code == 429:
            await asyncio.sleep(float(answer.headers["retry-after"]))
        elif answer.status_code != 503:
            answer.raise_for_status()
        return answer.status_code == 200

    async def jobs(self, key: str, until: float) -> list[float]:
        """Run one job after the other until a time, and return the seconds of each."""
        found: list[float] = []
        async with self.client(key) as http:
            while time.monotonic() < until or not found:
                begun = time.perf_counter()
                sent = {"asset": ("animal.glb", self._asset), "request": (None, json.dumps({"prompt": PROMPTS[0]}))}
                answer = await http.post("/v1/jobs", files=sent)
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
        for key in keys[1:]:
            await self.prepare(key)
        until = time.monotonic() + seconds
        people = (self.person(key, every_s, until) for key in keys[1:])
        return (await asyncio.gather(self.jobs(keys[0], until), *people))[0]


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=5)
    parser.add_argument("--every", type=float, default=3.0, help="mean seconds between two previews of a person")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    asset = asset_of(FACES)
    for prompt in TYPED:
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
    for name, seconds in (("first shape", load.first), ("six designs", load.six), ("exact shape", load.exact)):
        if seconds:
            p50, p95 = (float(np.percentile(seconds, q)) for q in (50, 95))
            print(f"{name}: {len(seconds)}, p50 {p50:.2f} s, p95 {p95:.2f} s")
    print(f"prompts overtaken before their first shape: {load.overtaken}; answers {dict(load.answers)}")
    print(
        f"jobs: alone {median(alone):.2f} s, beside {median(beside):.2f} s, {median(beside) / median(alone):.2f} times"
    )
    print(f"import torch: {import_torch()[0]:.2f} s")


if __name__ == "__main__":
    main()
