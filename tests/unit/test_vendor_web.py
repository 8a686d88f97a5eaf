"""The vendored libraries of the page are those of their manifest; edits, losses and strangers are found."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

from tests.cases import each_case

ROOT = Path(__file__).parents[2]
VENDOR = ROOT / "service" / "web" / "vendor"


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "scripts" / "vendor-web"), "--check", "--folder", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_the_committed_files_are_those_of_the_manifest() -> None:
    done = check(VENDOR)
    assert done.returncode == 0, done.stdout


@each_case(
    ("change", "message"),
    [
        (lambda folder: (folder / "three" / "LICENSE").write_text("mine"), "three/LICENSE: other bytes"),
        (lambda folder: (folder / "three" / "three.core.js").unlink(), "three/three.core.js: missing"),
        (lambda folder: (folder / "three" / "more.js").write_text(""), "three/more.js: not in the manifest"),
        (lambda folder: (folder / "manifest.json").unlink(), "manifest.json is missing"),
        (
            lambda folder: (folder / "three" / "addons" / "math" / "ColorSpaces.js").write_text(
                'import{A}from"three";'
            ),
            "imports 'three', which a browser cannot find",
        ),
    ],
    ids=["edited", "lost", "strange", "no manifest", "bare import"],
)
def test_what_differs_is_told(tmp_path: Path, change: object, message: str) -> None:
    folder = tmp_path / message.partition(" ")[0].replace("/", "-")
    shutil.copytree(VENDOR, folder)
    assert callable(change)
    change(folder)
    done = check(folder)
    assert done.returncode == 1
    assert message in done.stdout


def test_every_file_says_where_it_comes_from_and_nothing_is_copyleft() -> None:
    manifest = json.loads((VENDOR / "manifest.json").read_text())
    assert manifest["packages"][0]["integrity"].startswith("sha512-")
    licences = {package["license"] for package in manifest["packages"]}
    licences |= {entry["license"] for entry in manifest["files"].values() if "license" in entry}
    assert licences == {"MIT", "Apache-2.0", "MIT AND BSD-3-Clause"}
    for name, entry in manifest["files"].items():
        assert len(entry["sha256"]) == 64
        assert name == "three/LICENSE" or {"source", "source_sha256", "changed"} <= entry.keys()


def test_nothing_vendored_evaluates_text() -> None:
    """The page's policy has no 'unsafe-eval'; what is left of `new Function` is where nothing calls it."""
    for path in sorted(VENDOR.rglob("*.js")):
        text = path.read_text()
        assert "newFunc(Function" not in text, path
        assert "new Function(" not in text, path
