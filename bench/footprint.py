"""Measure the API's time until it answers, and its memory: ``python -m bench.footprint [--posts 1000]``.

`meshdeform api` on an empty SQLite record: seconds until `/healthz` answers, resident memory then and after checking 20
posted assets; with `--posts`, also after so many in all, sent by 30 clients, and half a minute later. A MB is 2**20
bytes, measured by the operating system.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import psutil

from bench.jobs import EXAMPLES
from meshdeform.serving.redis_server import RedisServer
from tests.servers import free_port

SPHERE = EXAMPLES / "sphere.glb"
FIRST, CLIENTS, LATER_S = 20, 30, 35.0


def api(folder: Path, posts: int) -> None:
    redis = RedisServer(folder / "redis")
    child = redis.start_and_wait()
    port = free_port()
    environment = {**os.environ, "MESHDEFORM_REDIS_URL": redis.url, "MESHDEFORM_DATA_DIR": str(folder / "data")}
    start = time.perf_counter()
    server = subprocess.Popen([sys.executable, "-m", "meshdeform", "api", "--port", str(port)], env=environment)
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as client:
            while True:
                try:
                    client.get("/healthz")
                    break
                except httpx.ConnectError:
                    time.sleep(0.01)
            up = time.perf_counter() - start
            process = psutil.Process(server.pid)
            idle = process.memory_info().rss / 2**20
            asset = SPHERE.read_bytes()

            def post(_: int) -> None:
                answer = client.post("/v1/jobs", files={"asset": asset}, data={"request": '{"prompt": "a vase"}'})
                answer.raise_for_status()

            for number in range(FIRST):
                post(number)
            busy = process.memory_info().rss / 2**20
            print(f"api   {up:6.2f} s until /healthz  {idle:6.0f} MB at first  {busy:6.0f} MB after {FIRST} posts")
            if posts > FIRST:
                before = sum(process.cpu_times()[:2])
                with ThreadPoolExecutor(CLIENTS) as clients:
                    list(clients.map(post, range(posts - FIRST)))
                most = process.memory_info().rss / 2**20
                spent = 1000 * (sum(process.cpu_times()[:2]) - before) / (posts - FIRST)
                time.sleep(LATER_S)
                left = process.memory_info().rss / 2**20
                print(f"      {most:6.0f} MB after {posts} posts  {left:6.0f} MB later  {spent:6.1f} ms CPU for one")
    finally:
        server.terminate()
        server.wait()
        child.stop(10.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--posts", type=int, default=0, help="measure also after so many posts")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        api(Path(folder), arguments.posts)


if __name__ == "__main__":
    main()
