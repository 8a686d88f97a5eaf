"""Measure the time and memory of a run and of the API: ``python bench/footprint.py [--preset NAME] [--prompt TEXT]``.

* run: `meshdeform run` from shell to file on a sphere of 5,120 faces: wall seconds, CPU seconds, peak resident memory
* api: `meshdeform api` on an empty SQLite record: seconds until `/healthz` answers, resident memory then and after
  checking 20 posted assets

Both are whole processes, measured by the operating system. Times depend on the machine; the ratio of wall to CPU
seconds shows how busy it was.
"""

from __future__ import annotations

import argparse
import os
import resource
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import httpx
import psutil

from meshdeform.serving.redis_server import RedisServer

ROOT = Path(__file__).resolve().parents[1]
SPHERE = ROOT / "examples" / "sphere.glb"


def run(preset: str, prompt: str, folder: Path) -> None:
    command = [sys.executable, "-m", "meshdeform", "run", str(SPHERE), prompt, "--preset", preset]
    start = time.perf_counter()
    subprocess.run([*command, "-o", str(folder / "out.glb")], check=True, stdout=subprocess.DEVNULL)
    wall = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime
    print(f"run   {wall:6.1f} s wall  {cpu:6.1f} s CPU  {used.ru_maxrss / 1024:6.0f} MB peak  ({preset}, {prompt!r})")


def api(folder: Path) -> None:
    redis = RedisServer(folder / "redis")
    child = redis.start_and_wait()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
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
            for _ in range(20):
                files = {"asset": SPHERE.read_bytes()}
                client.post("/v1/jobs", files=files, data={"request": '{"prompt": "a vase"}'}).raise_for_status()
            busy = process.memory_info().rss / 2**20
        print(f"api   {up:6.2f} s until /healthz  {idle:6.0f} MB at first  {busy:6.0f} MB after 20 posts")
    finally:
        server.terminate()
        server.wait()
        child.stop(10.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--preset", default="preview")
    parser.add_argument("--prompt", default="a mushroom")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        api(Path(folder))
        run(arguments.preset, arguments.prompt, Path(folder))


if __name__ == "__main__":
    main()
