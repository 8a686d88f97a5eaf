"""The scripts can be started by a person and by CI."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
import threading
import zipfile
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

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


@contextlib.contextmanager
def package_index(*wheels: tuple[str, bytes]) -> Iterator[str]:
    """Serve wheels as PEP 691 describes, each said to be a million times as large as it is, and give the URL."""
    files = dict(wheels)

    class Index(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            name = unquote(self.path).rstrip("/").rpartition("/")[2]
            listed = [
                {"filename": file, "url": f"/{file}", "hashes": {}, "size": len(data) * 1_000_000}
                for file, data in files.items()
                if file.startswith(f"{name}-")
            ]
            page = json.dumps({"meta": {"api-version": "1.1"}, "name": name, "files": listed}).encode()
            content = files.get(name, page)
            self.send_response(200 if listed or name in files else 404)
            self.send_header(
                "Content-Type", "application/vnd.pypi.simple.v1+json" if content is page else "binary/octet"
            )
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            if self.command == "GET":
                self.wfile.write(content)

        do_HEAD = do_GET

        def log_message(self, *args: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Index) as server:
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
    """Write a project that takes no time to build, with what `meshdeform[deform]` requires of torch; its script."""
    (folder / "scripts").mkdir(parents=True)
    name, made = wheel("meshdeform", "0.1", "Provides-Extra: deform", 'Requires-Dist: torch>=2.8; extra == "deform"')
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


CUDA = wheel("torch", "2.13.0", "Requires-Dist: cudart")
CPU = wheel("torch", "2.13.0+cpu")
REST = (wheel("cudart", "13.0"), wheel("pip", "99.0"))
WEIGHT = f"{(len(CUDA[1]) + len(REST[0][1])) / 1000:.1f} GB"


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
    with package_index(*own, *REST) as index, package_index(*torchs or ()) as torch_index:
        environment = {
            "PATH": no_gpu(tmp_path),
            "HOME": str(tmp_path),
            "PYTHON": sys.executable,
            "INSTALLER": installer,
            "PIP_CONFIG_FILE": os.devnull,
            "PIP_INDEX_URL": index,
            "TORCH_CPU_INDEX": torch_index if torchs else f"http://127.0.0.1:{free_port()}",
        }
        done = subprocess.run([script, "run"], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (packages,) = (tmp_path / "clone/.venv/lib").glob("python*/site-packages")
    assert [path.name for path in packages.glob("torch-*")] == [f"torch-{version}.dist-info"]
    assert told in done.stderr
    if told == "to download":
        assert environment["TORCH_CPU_INDEX"] in done.stderr
        # pip knows no sizes.
        assert (WEIGHT if installer == "uv" else "on PyPI 2.7 GB") in done.stderr
