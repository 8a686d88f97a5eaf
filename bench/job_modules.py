"""Count the modules whose functions run for one job, from its POST to the download of its result.

    python -m bench.job_modules [--list]

Starts `meshdeform serve` with a profile hook in every process, posts one short job, downloads the result, and counts
the files of meshdeform, service and worker in which a function was called in between, except those of the client.
Background work (the reconciler, heartbeats) also counts.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
import uuid
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    PORT = free.getsockname()[1]

HOOK = """
import atexit, json, os, sys, threading, time
root, out = os.environ["JOB_MODULES_ROOT"], os.environ["JOB_MODULES_OUT"]
last = {}
def hook(frame, event, arg):
    if event == "call":
        code = frame.f_code
        if code.co_filename.startswith(root) and code.co_name != "<module>":
            last[code.co_filename] = time.time()
def save():
    path = os.path.join(out, f"{os.getpid()}.json")
    with open(path + ".part", "w") as file:
        json.dump(dict(last), file)
    os.replace(path + ".part", path)
def keep_saving():
    while True:
        time.sleep(0.5)
        save()
sys.setprofile(hook)
threading.setprofile(hook)
threading.Thread(target=keep_saving, daemon=True).start()
atexit.register(save)
"""


def get(path: str) -> bytes:
    with urllib.request.urlopen(f"http://127.0.0.1:{PORT}{path}", timeout=60) as answer:
        content: bytes = answer.read()
    return content


def post(asset: bytes, request: dict[str, object]) -> dict[str, object]:
    edge = uuid.uuid4().hex
    body = (
        f'--{edge}\r\nContent-Disposition: form-data; name="request"\r\n\r\n{json.dumps(request)}\r\n'
        f'--{edge}\r\nContent-Disposition: form-data; name="asset"; filename="a.glb"\r\n\r\n'
    ).encode()
    body += asset + f"\r\n--{edge}--\r\n".encode()
    headers = {"Content-Type": f"multipart/form-data; boundary={edge}"}
    call = urllib.request.Request(f"http://127.0.0.1:{PORT}/v1/jobs", body, headers)
    with urllib.request.urlopen(call, timeout=120) as answer:
        document: dict[str, object] = json.loads(answer.read())
    return document


def main() -> None:
    """Run one job and print the count."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--list", action="store_true", help="Also print the modules.")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "sitecustomize.py").write_text(HOOK)
        environment = {
            **os.environ,
            "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}",
            "JOB_MODULES_ROOT": str(ROOT),
            "JOB_MODULES_OUT": folder,
            "OMP_NUM_THREADS": "1",
        }
        start = [sys.executable, "-c", "from meshdeform.cli import main; main()"]
        if (ROOT / "meshdeform/cli/app.py").exists():
            start[2] = "from meshdeform.cli.app import main; main()"
        serve = subprocess.Popen(
            [*start, "serve", "--port", str(PORT), "--data-dir", f"{folder}/data"], env=environment, cwd=ROOT
        )
        try:
            wait_for(lambda: get("/readyz"))
            wait_for(lambda: b"workers_alive 1" in get("/metrics") or None)
            began = time.time()
            params = {"preset": "preview", "steps": 10, "checkpoint_every_steps": 5}
            asset = (ROOT / "examples/cube.glb").read_bytes()
            job = post(asset, {"prompt": "a mushroom", "params": params})
            wait_for(lambda: over(str(job["id"])))
            get(f"/v1/jobs/{job['id']}/artifacts/result.glb")
            time.sleep(1.5)  # the hooks save twice a second
        finally:
            serve.send_signal(signal.SIGINT)
            serve.wait(60)
        called: set[str] = set()
        for path in Path(folder).glob("*.json"):
            called |= {name for name, at in json.loads(path.read_text()).items() if at >= began}
    names = sorted(str(Path(name).relative_to(ROOT)) for name in called)
    names = [name for name in names if name.startswith(("meshdeform/", "service/", "worker/"))]
    every = [p for top in ("meshdeform", "service", "worker") for p in (ROOT / top).rglob("*.py")]
    if arguments.list:
        print("\n".join(names))
    print(f"{len(names)} of {len(every)} modules")


def over(job_id: str) -> bool | None:
    """Return True when the job has ended."""
    state = json.loads(get(f"/v1/jobs/{job_id}"))["state"]
    if state in ("failed", "canceled", "expired"):
        raise SystemExit(f"the job is {state}")
    return True if state == "succeeded" else None


def wait_for(ask: object) -> None:
    """Ask until there is an answer that is not None."""
    for _ in range(600):
        try:
            if ask() is not None:  # type: ignore[operator]
                return
        except OSError:
            pass
        time.sleep(0.5)
    raise SystemExit("nothing came")


if __name__ == "__main__":
    main()
