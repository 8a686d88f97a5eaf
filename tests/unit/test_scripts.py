"""The scripts can be started by a person and by CI."""

from __future__ import annotations

import contextlib
import functools
import io
import os
import shutil
import subprocess
import sys
import threading
import zipfile
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from tests.cases import each_case
from tests.servers import free_port


@each_case(("profile", "python", "said"), [("everything", sys.executable, "use run"), ("run", "/none", "3.11")])
def test_setup_makes_nothing_of_what_it_cannot_use(
    profile: str, python: str, said: str, repository: Path, tmp_path: Path
) -> None:
    environment = {**os.environ, "VENV": str(tmp_path / "venv"), "PYTHON": python}
    command = [repository / "scripts/setup", profile]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert said in done.stderr
    assert not (tmp_path / "venv").exists()


def wheel(name: str, version: str, *metadata: str) -> tuple[str, bytes]:
    """Return the file name and the bytes of a wheel with one empty module."""
    information = f"{name}-{version}.dist-info"
    lines = ("Metadata-Version: 2.1", f"Name: {name}", f"Version: {version}", *metadata)
    files = {
        f"{name}.py": "",
        f"{information}/METADATA": "".join(f"{line}\n" for line in lines),
        f"{information}/WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    files[f"{information}/RECORD"] = "".join(f"{path},,\n" for path in [*files, f"{information}/RECORD"])
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for path, text in files.items():
            archive.writestr(path, text)
    return f"{name}-{version}-py3-none-any.whl", made.getvalue()


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *args: object) -> None:
        """Say nothing."""


@contextlib.contextmanager
def package_index(folder: Path, *wheels: tuple[str, bytes]) -> Iterator[str]:
    """Serve wheels from a folder for each project, whose listings are what PEP 503 describes, and give the URL."""
    folder.mkdir()
    for name, data in wheels:
        project = folder / name.partition("-")[0]
        project.mkdir(exist_ok=True)
        (project / name).write_bytes(data)
    with ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=folder)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


BACKEND = """import shutil
def build_editable(folder, config_settings=None, metadata_directory=None):
    return shutil.copy("WHEEL", folder).rpartition("/")[2]
"""
PROJECT = """[build-system]
requires = []
build-backend = "backend"
backend-path = ["."]
"""


def write_clone(folder: Path, script: Path) -> Path:
    """Write a project that takes no time to build, with what its extras require of torch; its scripts."""
    (folder / "scripts").mkdir(parents=True)
    extras = ("Provides-Extra: deform", "Provides-Extra: sds", 'Requires-Dist: torch>=2.8; extra == "sds"')
    name, made = wheel("meshdeform", "0.1", *extras)
    (folder / name).write_bytes(made)
    (folder / "backend.py").write_text(BACKEND.replace("WHEEL", str(folder / name)))
    (folder / "pyproject.toml").write_text(PROJECT)
    return shutil.copy(script, folder / "scripts")


def no_gpu(folder: Path) -> str:
    """Return a PATH on which no GPU is found."""
    program = folder / "nvidia-smi"
    program.write_text("#!/bin/sh\nexit 1\n")
    program.chmod(0o755)
    return f"{folder}{os.pathsep}{os.environ['PATH']}"


CUDA, CPU = wheel("torch", "2.13.0"), wheel("torch", "2.13.0+cpu")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the package index has no CUDA build")
@pytest.mark.parametrize(
    ("own", "torchs", "version", "told"),
    [
        ((CUDA,), None, "2.13.0", "to download"),
        ((CUDA,), (CPU,), "2.13.0+cpu", "CPU build"),
        ((CUDA, CPU), None, "2.13.0+cpu", "CPU build"),
    ],
    ids=["nowhere", "in torch's index", "in the package index"],
)
@pytest.mark.parametrize("installer", ["pip", "uv"])
def test_setup_takes_the_cpu_build_of_torch_or_says_what_the_other_weighs(
    own: tuple[tuple[str, bytes], ...],
    torchs: tuple[tuple[str, bytes], ...] | None,
    version: str,
    told: str,
    installer: str,
    repository: Path,
    tmp_path: Path,
) -> None:
    uv = shutil.which("uv", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if uv is None:
        pytest.skip("uv is not installed (scripts/setup dev)")
    (tmp_path / "uv").symlink_to(uv)
    script = write_clone(tmp_path / "clone", repository / "scripts/setup")
    with (
        package_index(tmp_path / "own", *own, wheel("pip", "99.0")) as index,
        package_index(tmp_path / "torchs", *torchs or ()) as torch_index,
    ):
        environment = {
            "PATH": no_gpu(tmp_path),
            "HOME": str(tmp_path),
            "PYTHON": sys.executable,
            "INSTALLER": installer,
            "PIP_CONFIG_FILE": os.devnull,
            "PIP_INDEX_URL": index,
            "TORCH_CPU_INDEX": torch_index if torchs else f"http://127.0.0.1:{free_port()}",
        }
        done = subprocess.run([script, "sds"], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (packages,) = (tmp_path / "clone/.venv/lib").glob("python*/site-packages")
    assert [path.name for path in packages.glob("torch-*")] == [f"torch-{version}.dist-info"]
    assert told in done.stderr
    if told == "to download":
        assert environment["TORCH_CPU_INDEX"] in done.stderr


@pytest.mark.parametrize(
    ("options", "torch", "arguments"),
    [
        ([], False, "run examples/sphere.glb a mushroom -o mushroom.glb"),
        (["--sds", "a vase"], True, "run examples/sphere.glb a vase -o mushroom.glb --guidance sds --preset preview"),
    ],
    ids=["fit", "sds"],
)
def test_the_demo_installs_what_it_needs_and_runs_it(
    options: list[str], torch: bool, arguments: str, repository: Path, tmp_path: Path
) -> None:
    clone, venv = tmp_path / "clone", tmp_path / "venv"
    write_clone(clone, repository / "scripts/setup")
    script = shutil.copy(repository / "scripts/demo", clone / "scripts")
    with package_index(tmp_path / "own", CPU, wheel("pip", "99.0")) as index:
        environment = {
            "PATH": no_gpu(tmp_path),
            "HOME": str(tmp_path),
            "PYTHON": sys.executable,
            "VENV": str(venv),
            "INSTALLER": "pip",
            "PIP_CONFIG_FILE": os.devnull,
            "PIP_INDEX_URL": index,
        }
        installed = subprocess.run(
            [clone / "scripts/setup", "sds" if torch else "run"], env=environment, capture_output=True, check=False
        )
        assert installed.returncode == 0, installed.stderr
        (packages,) = (venv / "lib").glob("python*/site-packages")
        assert bool(list(packages.glob("torch-*"))) is torch
        program = venv / "bin/meshdeform"
        program.write_text('#!/bin/sh\necho "$@"\n')
        program.chmod(0o755)
        done = subprocess.run([script, *options], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip().replace(f"{clone}/", "") == arguments
