"""What is released: the wheel holds what an installed Meshdeform needs, the bill of materials names the rest."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from meshdeform import __version__
from meshdeform.assets import build_glb
from meshdeform.geometry.shapes import icosphere
from release.build import build, wrong_with
from release.licences import dependencies, forbidden, licence
from release.rehearsal import rehearse
from tests.acceptance.service import SMALLER
from tests.cases import each_case


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    out = tmp_path_factory.mktemp("dist")
    with pytest.MonkeyPatch.context() as patch:
        # The tests of the client pack it (tests/typescript_package.py); once is enough.
        patch.setattr("release.build.packed", lambda folder: (folder / f"meshdeform-{__version__}.tgz").touch())
        files = build(out)
    assert sorted(path.name for path in out.iterdir()) == sorted(path.name for path in files)
    return {"".join(path.suffixes[-1:]) or path.name: path for path in files}


@pytest.fixture(scope="module")
def installed(released: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, in a folder of its own; what it depends on comes from this environment."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index", "--target", str(folder)]
    subprocess.run([*command, str(released[".whl"])], check=True)
    _take_compiled(folder)
    return folder


def _take_compiled(folder: Path) -> None:
    """Copy numba's cache to the same sources there, with their times: to compile the kernels again takes longer."""
    for index in (Path(__file__).parents[2] / "meshdeform").rglob("__pycache__/*.nb?"):
        place = folder / index.relative_to(Path(__file__).parents[2])
        source = index.parents[1] / f"{index.name.partition('.')[0]}.py"
        copied = place.parents[1] / source.name
        if copied.exists() and copied.read_bytes() == source.read_bytes():
            os.utime(copied, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
            place.parent.mkdir(exist_ok=True)
            shutil.copy2(index, place)


@pytest.mark.slow
def test_the_installed_wheel_deforms_without_the_repository(installed: Path, tmp_path: Path) -> None:
    asset, ball = tmp_path / "ball.glb", icosphere(2)
    asset.write_bytes(build_glb(ball.verts, ball.faces))
    environment = {**os.environ, "PYTHONPATH": f"{installed}:{SMALLER}"}
    where = "import meshdeform, service, worker; print(meshdeform.__file__, service.__file__, worker.__file__)"
    python = [sys.executable, "-P"]
    done = subprocess.run([*python, "-c", where], env=environment, check=True, capture_output=True, text=True)
    assert all(Path(path).is_relative_to(installed) for path in done.stdout.split())
    command = [*python, "-m", "meshdeform", "run", str(asset), "a mushroom", "-o", "m.glb", "--set", "orientation=keep"]
    subprocess.run(command, env=environment, cwd=tmp_path, check=True, capture_output=True)
    assert {path.name for path in tmp_path.iterdir()} >= {"m.glb", "m.report.json", "m.preview.png"}


@pytest.mark.slow
def test_what_is_released_is_uploaded_and_installed_from_a_local_index_and_registry(
    released: dict[str, Path], tmp_path: Path
) -> None:
    """The package of the TypeScript client is a small one of the same name: tests of the client pack the real one."""
    for path in released.values():
        shutil.copy(path, tmp_path)
    about = {"name": "meshdeform", "version": __version__, "type": "module", "exports": "./index.js"}
    with tarfile.open(tmp_path / f"meshdeform-{__version__}.tgz", "w:gz") as archive:
        for name, text in {"package.json": json.dumps(about), "index.js": "export class Client {}"}.items():
            entry = tarfile.TarInfo(f"package/{name}")
            entry.size = len(text)
            archive.addfile(entry, io.BytesIO(text.encode()))
    said: list[str] = []
    with pytest.raises(SystemExit, match="is not the file of SHA256SUMS"):
        rehearse(tmp_path, said.append)
    files = sorted(path for path in tmp_path.iterdir() if path.name != "SHA256SUMS")
    sums = (f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files)
    (tmp_path / "SHA256SUMS").write_text("".join(sums))
    rehearse(tmp_path, said.append)
    assert len(said) == 5


def test_a_wheel_that_lacks_or_leaks_something_is_noticed(tmp_path: Path) -> None:
    wheel = tmp_path / "meshdeform-0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("meshdeform/py.typed", "")
        archive.writestr("tests/test_x.py", "")
        archive.writestr("service/__pycache__/app.pyc", "")
    wrong = wrong_with(wheel)
    assert "lacks service/web/index.html" in wrong
    assert "lacks meshdeform/py.typed" not in wrong
    assert "has tests/test_x.py, which belongs nowhere" in wrong
    assert "has service/__pycache__/app.pyc, which was left behind" in wrong


def test_the_bill_names_every_dependency_with_its_licence_and_is_the_same_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from release.sbom import bill_of_materials

    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1767225600")
    written = bill_of_materials()
    assert bill_of_materials() == written
    bill = json.loads(written)
    assert bill["metadata"]["component"]["name"] == "meshdeform"
    parts = {part["name"]: part for part in bill["components"]}
    assert parts.keys() >= dependencies("all").keys() - {"meshdeform"}
    assert parts.keys() >= {"torch", "fastapi", "three", "Draco"}
    assert [name for name, part in parts.items() if not part.get("licenses")] == []
    edges = {edge["ref"]: set(edge.get("dependsOn", [])) for edge in bill["dependencies"]}
    assert parts["starlette"]["bom-ref"] in edges[parts["fastapi"]["bom-ref"]]
    assert parts["three"]["bom-ref"] in edges[bill["metadata"]["component"]["bom-ref"]]


def test_a_bill_with_a_forbidden_licence_is_not_written(monkeypatch: pytest.MonkeyPatch) -> None:
    from release.sbom import bill_of_materials

    monkeypatch.setattr("release.sbom.licence", lambda name: "AGPL-3.0-only" if name == "rq" else licence(name))
    with pytest.raises(SystemExit, match=r"rq: AGPL-3\.0-only"):
        bill_of_materials()


@each_case("text", ["LGPL-3.0-only", "GNU General Public License v2", "CC-BY-NC-4.0", "AGPL-3.0"])
def test_forbidden_licences_are_known(text: str) -> None:
    assert forbidden(text)
    assert not any(map(forbidden, ("MIT", "MPL-2.0", "BSD-3-Clause AND GPL-3.0-or-later WITH GCC-exception-3.1")))
