"""Check the machine: graphics card, disk, data directory, port, clock."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from meshdeform.cli.diagnosis.checks import Finding, Subject, fail, ok, skip, warn

__all__ = ["GPU_TIMEOUT_S", "check_clock", "check_data_dir", "check_disk", "check_gpu", "check_port", "nearest"]

GPU_TIMEOUT_S = 90.0
_GIB, _MIB = 2**30, 2**20
_ENOUGH, _TOO_LITTLE = 2 * _GIB, 200 * _MIB
_SKEW_S = 5.0
_BUILT = 1_750_000_000  # seconds; an earlier time is wrong
_TORCH_ADVICE = "Install the CUDA build of torch (README, Install)."

# Runs in a separate process, since a broken driver can hang or crash it.
_PROBE = """
import json, warnings
warnings.simplefilter("ignore")
import torch
found = {"torch": torch.__version__, "build": torch.version.cuda or torch.version.hip, "devices": [], "error": ""}
try:
    for number in range(torch.cuda.device_count()):
        torch.cuda.set_device(number)
        ones = torch.ones(8, 8, device="cuda")
        free, total = torch.cuda.mem_get_info()
        works = float((ones @ ones).sum().item()) == 512.0
        name = torch.cuda.get_device_name(number)
        found["devices"].append({"name": name, "free": free, "total": total, "works": works})
    if not found["devices"] and found["build"]:
        torch.cuda.init()
except Exception as error:
    found["error"] = str(error).strip().splitlines()[0]
print(json.dumps(found))
"""


def check_gpu(subject: Subject) -> Iterator[Finding]:
    """Check that torch fits the driver and that a kernel runs."""
    if find_spec("torch") is None:
        yield skip("gpu", "torch is not installed")
        return
    driver = _driver()
    done = subprocess.run(
        [sys.executable, "-P", "-c", _PROBE], capture_output=True, text=True, check=False, timeout=GPU_TIMEOUT_S - 5
    )
    try:
        found: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        yield fail("gpu", f"torch cannot be imported: {last}", "Install torch again (README, Install).")
        return
    yield _gpu(subject.settings.device, driver, found)


def _gpu(device: str, driver: str, found: dict[str, Any]) -> Finding:
    wanted, torch = device.startswith("cuda"), f"torch {found['torch']}"
    if found["devices"] and not found["error"]:
        broken = [each["name"] for each in found["devices"] if not each["works"]]
        cards = [
            f"{each['name']}, {each['free'] / _GIB:.1f} of {each['total'] / _GIB:.1f} GiB free"
            for each in found["devices"]
        ]
        detail = f"{'; '.join(cards)}; {torch}" + (f", driver {driver}" if driver else "")
        return (
            fail("gpu", f"{detail}: wrong results on {', '.join(broken)}", _TORCH_ADVICE)
            if broken
            else ok("gpu", detail)
        )
    if driver and not found["build"]:
        detail = f"there is a graphics card (driver {driver}), but {torch} is a build for the CPU"
        return fail("gpu", detail, _TORCH_ADVICE) if wanted else warn("gpu", detail, _TORCH_ADVICE)
    if driver:
        detail = f"{torch} for CUDA {found['build']} cannot use the driver {driver}: {found['error'] or 'no device'}"
        return fail("gpu", detail, "Update the driver, or install a torch that is built for it.")
    if wanted:
        return fail("gpu", f"MESHDEFORM_DEVICE is {device}, and there is no graphics card", "Set it to auto or cpu.")
    return ok("gpu", f"none; {torch} computes on the CPU")


def _driver() -> str:
    """Return the version of the NVIDIA driver; empty if there is none."""
    program = shutil.which("nvidia-smi")
    if program is None:
        return ""
    command = [program, "--query-gpu=driver_version", "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=20.0)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    lines = done.stdout.split() if done.returncode == 0 else []
    return lines[0] if lines else ""


def nearest(path: Path) -> Path:
    """Return the path itself or its nearest existing ancestor."""
    path = path.absolute()
    while not path.exists():
        path = path.parent
    return path


def check_disk(subject: Subject) -> Iterator[Finding]:
    """Check the free space for results and temporary files."""
    places = {nearest(place).stat().st_dev: nearest(place) for place in (Path(tempfile.gettempdir()), subject.data_dir)}
    for place in places.values():
        free = shutil.disk_usage(place).free
        detail = f"{free / _GIB:.1f} GiB free in {place}"
        if free < _TOO_LITTLE:
            yield fail("disk", detail, "Free some space: jobs fail when the disk is full.")
        elif free < _ENOUGH:
            yield warn("disk", detail, "A job's results and checkpoints take up to a few hundred MiB: free some space.")
        else:
            yield ok("disk", detail)


def check_data_dir(subject: Subject) -> Iterator[Finding]:
    """Check that `serve` could write to its folder."""
    place, found = subject.data_dir.absolute(), nearest(subject.data_dir)
    if not found.is_dir():
        yield fail("data directory", f"{found} is not a folder", "Choose another one with --data-dir.")
        return
    try:
        with tempfile.TemporaryFile(dir=found):
            pass
    except OSError as error:
        yield fail("data directory", f"{found} cannot be written: {error.strerror}", "Make it writable, or --data-dir.")
        return
    if found != place:
        yield ok("data directory", f"{place} will be created by the first `serve`")
    elif found.stat().st_mode & 0o002:
        yield warn("data directory", f"every user of this machine can write to {place}", f"chmod o-w {place}")
    else:
        yield ok("data directory", f"{place}{', in use by a running `serve`' if _locked(place) else ''}")


def _locked(folder: Path) -> bool:
    try:
        handle = os.open(folder / "serve.lock", os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False


def check_port(subject: Subject) -> Iterator[Finding]:
    """Check that `serve` could listen, or already does."""
    place = f"{subject.host} port {subject.port}"
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(subject.host, subject.port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        version = _version_at(subject)
        if version:
            yield ok("port", f"Meshdeform {version} is running on {place}")
        else:
            advice = "Choose another with --port (0 takes a free one), or stop the program that uses it."
            yield warn("port", f"{place} cannot be used: {error.strerror}", advice)
    else:
        yield ok("port", f"{place} is free")


def _version_at(subject: Subject) -> str:
    import httpx

    host = f"[{subject.host}]" if ":" in subject.host else subject.host
    try:
        answer = httpx.get(f"http://{host}:{subject.port}/healthz", timeout=subject.timeout_s, trust_env=False)
        return str(answer.json()["version"])
    except (httpx.HTTPError, ValueError, KeyError, TypeError):
        return ""


def check_clock(subject: Subject) -> Iterator[Finding]:
    """Compare our clock with those of the servers; run this after their checks."""
    if time.time() < _BUILT:
        yield fail("clock", f"it shows {time.strftime('%Y-%m-%d')}", "Set the clock.")
        return
    off = {server: skew for server, skew in subject.skews_s.items() if abs(skew) > _SKEW_S}
    if off:
        detail = ", ".join(
            f"{server} is {abs(skew):.0f} s {'ahead' if skew > 0 else 'behind'}" for server, skew in off.items()
        )
        yield warn("clock", detail, "Synchronise the clocks: signed URLs and deadlines depend on them.")
    elif subject.skews_s:
        yield ok("clock", f"agrees with {', '.join(subject.skews_s)}")
    else:
        yield ok("clock", time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()))
