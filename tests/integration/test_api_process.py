"""What the API costs as a process of its own: no numpy, little memory, and a clean end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import psutil
import pytest

from tests.integration.conftest import DEADLINE_S
from tests.servers import free_port

MAX_RSS = 120 * 2**20

# Starts the application in this process, then tells on a line what was loaded by then and when it ends.
_SERVE = """
import json, signal, sys
import uvicorn
from service.app import create_app

class Server(uvicorn.Server):
    async def shutdown(self, sockets=None):
        await super().shutdown(sockets)
        print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})), flush=True)

Server(uvicorn.Config(create_app(), host="127.0.0.1", port=int(sys.argv[1]), log_level="warning")).run()
"""


@contextmanager
def api_process(folder: Path, redis_url: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    port = free_port()
    environment = {
        **os.environ,
        "MESHDEFORM_DATA_DIR": str(folder),
        "MESHDEFORM_REDIS_URL": redis_url,
        "MESHDEFORM_QUEUE": f"test-{folder.name}",
    }
    command = [sys.executable, "-c", _SERVE, str(port)]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        url = f"http://127.0.0.1:{port}"
        deadline = time.monotonic() + DEADLINE_S
        while True:
            assert process.poll() is None, "the API ended"
            assert time.monotonic() < deadline, "the API does not answer"
            try:
                if httpx.get(f"{url}/readyz").status_code == 200:
                    break
            except httpx.TransportError:
                time.sleep(0.02)
        yield process, url
    finally:
        process.kill()
        process.communicate()


@pytest.mark.long  # test_imports.py has what is imported
@pytest.mark.skipif(sys.platform != "linux", reason="memory is measured as Linux counts it")
def test_the_api_needs_no_numpy_and_little_memory(redis_url: str, tmp_path: Path, repository: Path) -> None:
    with api_process(tmp_path, redis_url) as (process, url), httpx.Client(base_url=url, timeout=DEADLINE_S) as http:
        for name in ("sphere", "cube", "vase"):
            asset = (repository / "examples" / f"{name}.glb").read_bytes()
            answer = http.post(
                "/v1/jobs", files={"asset": (f"{name}.glb", asset), "request": (None, '{"prompt": "a vase"}')}
            )
            assert answer.status_code == 202, answer.text
        # A large body that is refused: it must not pass through memory.
        refused = http.post(
            "/v1/jobs",
            files={"asset": ("a.glb", b"glTF" + bytes(80 * 2**20)), "request": (None, '{"prompt": "a vase"}')},
        )
        assert refused.status_code == 415
        for path in ("/v1/jobs", "/openapi.json", f"/v1/jobs/{answer.json()['id']}/artifacts"):
            assert http.get(path).status_code == 200
        rss = psutil.Process(process.pid).memory_info().rss
        process.send_signal(signal.SIGTERM)
        output, _ = process.communicate(timeout=DEADLINE_S)
    loaded = set(json.loads(output))
    assert loaded & {"numpy", "torch", "scipy", "numba", "trimesh", "PIL", "diffusers"} == set()
    assert rss < MAX_RSS, f"{rss / 2**20:.0f} MiB"
