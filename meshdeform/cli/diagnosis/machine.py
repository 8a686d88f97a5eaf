"""The machine: graphics card, disk, data directory, port, clock."""

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

from meshdeform.cli.diagnosis.checks import Finding, Patient, fail, ok, skip, warn

__all__ = ["GPU_TIMEOUT_S", "check_clock", "check_data_dir", "check_disk", "check_gpu", "check_port", "nearest"]

GPU_TIMEOUT_S = 90.0
_GIB, _MIB = 2**30, 2**20
_ENOUGH, _TOO_LITTLE = 2 * _GIB, 200 * _MIB
_SKEW_S = 5.0
_BUILT = 1_750_000_000  # seconds; Meshdeform is younger than that
_TORCH_ADVICE = "Install the CUDA build of torch (README, Install)."

# In a process of its own: a driver that is broken can hang or crash whoever asks it.
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


def check_gpu(patient: Patient) -> Iterator[Finding]:
    """Whether torch and the driver agree, and a kernel runs."""
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
    yield _gpu(patient.settings.device, driver, found)


def _gpu(device: str, driver: str, found: dict[str, Any]) -> Finding:
    wanted, torch = device.startswith("cuda"), f"torch {found['torch']}"
    if found["devices"] and not found["error"]:
        broken = [each["name"] for each in found["devices"] if not each["works"]]
        told = [
            f"{each['name']}, {each['free'] / _GIB:.1f} of {each['total'] / _GIB:.1f} GiB free"
            for each in found["devices"]
        ]
        said = f"{'; '.join(told)}; {torch}" + (f", driver {driver}" if driver else "")
        return (
            fail("gpu", f"{said}: wrong results on {', '.join(broken)}", _TORCH_ADVICE) if broken else ok("gpu", said)
        )
    if driver and not found["build"]:
        said = f"there is a graphics card (driver {driver}), but {torch} is a build for the CPU"
        return fail("gpu", said, _TORCH_ADVICE) if wanted else warn("gpu", said, _TORCH_ADVICE)
    if driver:
        said = f"{torch} for CUDA {found['build']} cannot use the driver {driver}: {found['error'] or 'no device'}"
        return fail("gpu", said, "Update the driver, or install a torch that is built for it.")
    if wanted:
        return fail("gpu", f"MESHDEFORM_DEVICE is {device}, and there is no graphics card", "Set it to auto or cpu.")
    return ok("gpu", f"none; {torch} computes on the CPU")


def _driver() -> str:
    """The version of NVIDIA's driver; empty where there is none."""
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
    """The path itself, or its nearest ancestor that exists."""
    path = path.absolute()
    while not path.exists():
        path = path.parent
    return path


def check_disk(patient: Patient) -> Iterator[Finding]:
    """Room for results, and for what is put aside meanwhile."""
    places = {nearest(place).stat().st_dev: nearest(place) for place in (Path(tempfile.gettempdir()), patient.data_dir)}
    for place in places.values():
        free = shutil.disk_usage(place).free
        said = f"{free / _GIB:.1f} GiB free in {place}"
        if free < _TOO_LITTLE:
            yield fail("disk", said, "Make room: jobs fail when the disk is full.")
        elif free < _ENOUGH:
            yield warn("disk", said, "A job's results and checkpoints take up to a few hundred MiB: make room.")
        else:
            yield ok("disk", said)


def check_data_dir(patient: Patient) -> Iterator[Finding]:
    """Whether `serve` could write where it keeps everything."""
    place, found = patient.data_dir.absolute(), nearest(patient.data_dir)
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
        yield ok("data directory", f"{place} is made by the first `serve`")
    elif found.stat().st_mode & 0o002:
        yield warn("data directory", f"everybody on this machine can write to {place}", f"chmod o-w {place}")
    else:
        yield ok("data directory", f"{place}{', a `serve` runs on it' if _locked(place) else ''}")


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


def check_port(patient: Patient) -> Iterator[Finding]:
    """Whether `serve` could listen, or does."""
    place = f"{patient.host} port {patient.port}"
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(patient.host, patient.port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        version = _version_at(patient)
        if version:
            yield ok("port", f"a Meshdeform {version} answers on {place}")
        else:
            advice = "Choose another with --port (0 takes a free one), or end what listens there."
            yield warn("port", f"{place} cannot be taken: {error.strerror}", advice)
    else:
        yield ok("port", f"{place} is free")


def _version_at(patient: Patient) -> str:
    import httpx

    host = f"[{patient.host}]" if ":" in patient.host else patient.host
    try:
        answer = httpx.get(f"http://{host}:{patient.port}/healthz", timeout=patient.timeout_s, trust_env=False)
        return str(answer.json()["version"])
    except (httpx.HTTPError, ValueError, KeyError, TypeError):
        return ""


def check_clock(patient: Patient) -> Iterator[Finding]:
    """Our clock beside those of the servers that were asked; to be run after them."""
    if time.time() < _BUILT:
        yield fail("clock", f"it says {time.strftime('%Y-%m-%d')}", "Set the clock.")
        return
    off = {whose: skew for whose, skew in patient.skews_s.items() if abs(skew) > _SKEW_S}
    if off:
        said = ", ".join(
            f"{whose} is {abs(skew):.0f} s {'ahead' if skew > 0 else 'behind'}" for whose, skew in off.items()
        )
        yield warn("clock", said, "Synchronise the clocks: signed URLs and deadlines go by them.")
    elif patient.skews_s:
        yield ok("clock", f"agrees with {', '.join(patient.skews_s)}")
    else:
        yield ok("clock", time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()))
