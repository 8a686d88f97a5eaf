"""Send an API more than it asked for: ``python -m bench.floods [--megabytes 20]``.

An API process of its own, and for each row connections without a key whose client reads nothing: pipelined requests,
pipelined requests behind a stream of events, headers without an end on ten connections. A row has the bytes that the
API took, the memory of its process before and afterwards, and the slowest of another client's requests meanwhile. Exits
with 1 if an attack left more than 50 MiB.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import httpx
import psutil

from tests.acceptance.cluster import Cluster, deployed
from tests.security.test_connections import connect
from tests.security.test_pipelined_requests import ALIVE, HEAD, LINE, MIB, push

MOST_MIB = 50


class Others:
    """Another client, whose slowest request is remembered."""

    def __init__(self, url: str) -> None:
        self.slowest_s = 0.0
        self._url, self._done = url, threading.Event()
        self._thread = threading.Thread(target=self._ask)

    def __enter__(self) -> Others:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _ask(self) -> None:
        with httpx.Client(base_url=self._url, timeout=120.0) as client:
            while not self._done.wait(0.05):
                start = time.monotonic()
                client.get("/healthz").raise_for_status()
                self.slowest_s = max(self.slowest_s, time.monotonic() - start)


def row(cluster: Cluster, process: psutil.Process, name: str, sent: list[bytes]) -> bool:
    """Run one attack, print its row, and return whether the memory stayed."""
    before = process.memory_info().rss / MIB
    url = str(cluster.http.base_url)
    with ExitStack() as cleanup, Others(url) as others:
        taken = sum(push(cleanup.enter_context(connect(url)), each) for each in sent)
    after = process.memory_info().rss / MIB
    print(f"{name:32} {taken / MIB:6.1f} MiB {before:6.0f} -> {after:6.0f} MiB {others.slowest_s:6.2f} s", flush=True)
    return after - before < MOST_MIB


def main() -> None:
    """Read the options and run the attacks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megabytes", type=int, default=20, help="what each connection sends at most")
    size = parser.parse_args().megabytes * MIB
    with tempfile.TemporaryDirectory() as folder, deployed(Path(folder)) as cluster:
        process = psutil.Process(cluster.start_api().pid)
        events = f"GET /v1/jobs/{cluster.submit()}/events HTTP/1.1\r\nHost: x\r\n\r\n".encode()
        requests = ALIVE * (size // len(ALIVE))
        attacks = {
            "pipelined requests": [requests],
            "pipelined behind events": [events + requests],
            "headers without an end": [HEAD + LINE * (size // len(LINE))] * 10,
            "a header without an end": [HEAD + b"X-a: " + b"b" * size] * 10,
        }
        good = [row(cluster, process, *attack) for attack in attacks.items()]
    sys.exit(not all(good))


if __name__ == "__main__":
    main()
