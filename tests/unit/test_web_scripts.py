"""The page's scripts that need no browser: the tests of tests/web, as `node --test` runs them."""

from __future__ import annotations

import io
import json
import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from meshdeform.assets import load_asset
from meshdeform.requests.document import JobRequest, resolve
from meshdeform.runs.base import sha256_hex
from tests.cases import each_case

ROOT = Path(__file__).parents[2]
WEB = ROOT / "service" / "web"
OWN = [WEB / "index.html", *sorted((WEB / "app").rglob("*.js")), *sorted((WEB / "style").rglob("*.css"))]
CLIENT = sorted((WEB / "client").glob("*.js"))


def test_the_scripts_do_what_their_tests_say() -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    tests = sorted(str(path) for path in (ROOT / "tests" / "web").glob("*.test.js"))
    assert tests
    # One process for all files: `node --test` starts one for each, which takes longer than what it tests.
    every = "for (const file of process.argv.slice(1)) await import(file);"
    command = [node, "--input-type=module", "--eval", every, *tests]
    found = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    passed = re.search(r"pass (\d+)", found.stdout)
    assert passed is not None
    assert int(passed[1]) >= len(tests)


@each_case("path", [*OWN, *CLIENT], ids=lambda path: str(path.relative_to(WEB)))
def test_nothing_that_the_policy_forbids_and_nothing_that_reads_data_as_html(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"\b(?:innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(|new Function)", text)
    if path in CLIENT:  # compiled; its defaults and examples name hosts, the page's tests watch what is asked
        return
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)[\w.]+", text), "another host"
    if path.suffix == ".html":
        assert " style=" not in text
        assert not re.search(r"\son\w+=", text)
        assert not re.search(r"<script(?![^>]*\ssrc=)", text)
    if path.suffix == ".js":
        assert text.startswith("// @ts-check\n")


def test_every_file_that_the_page_names_is_there() -> None:
    named = re.findall(r'(?:src|href)="(web/[^"]+)"', (WEB / "index.html").read_text(encoding="utf-8"))
    named += [f"web/examples/{name}" for name in re.findall(r'name: "(\w+\.glb)"', _script("create/asset-panel.js"))]
    assert len(named) > 8
    for name in named:
        assert (WEB / name.removeprefix("web/")).is_file(), name
    for path in sorted((WEB / "style").glob("*.css")):
        for name in re.findall(r'url\("([^"]+)"\)', path.read_text(encoding="utf-8")):
            assert (path.parent / name).is_file(), name


def test_the_examples_are_small_and_every_one_is_deformable() -> None:
    from meshdeform.assets import inspect_asset

    files = sorted((WEB / "examples").glob("*.glb"))
    assert sum(path.stat().st_size for path in files) < 400_000
    for path in files:
        assert inspect_asset(path.read_bytes(), path.name).triangles > 1000


def _script(name: str) -> str:
    return (WEB / "app" / name).read_text(encoding="utf-8")


# The vendored libraries of the page are those of their manifest; edits, losses and strangers are found.


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


# The examples that come with the page: each result is its source in another shape, made by the request beside it.


FOLDER = Path(__file__).parents[2] / "service" / "web" / "examples"
EXAMPLES: list[dict[str, Any]] = json.loads((FOLDER / "gallery.json").read_text())["examples"]
LARGEST_BYTES = 1_500_000


def recorded(glb: bytes) -> dict[str, Any]:
    """What a result says about the request that made it."""
    (length,) = struct.unpack_from("<I", glb, 12)
    found: dict[str, Any] = json.loads(glb[20 : 20 + length])["asset"]["extras"]["meshdeform"]
    return found


def test_the_examples_are_named_once_and_small_together() -> None:
    names = [example["id"] for example in EXAMPLES]
    assert len(names) == len(set(names)) >= 6
    held = {path.name for path in (FOLDER / "gallery").iterdir()}
    assert held == {f"{name}.{ending}" for name in names for ending in ("glb", "webp")}
    assert sum(path.stat().st_size for path in (FOLDER / "gallery").iterdir()) < LARGEST_BYTES


@each_case("example", EXAMPLES, ids=lambda example: example["id"])
def test_a_result_is_its_source_in_another_shape_by_the_request_beside_it(example: dict[str, Any]) -> None:
    data, made = (FOLDER / example["asset"]).read_bytes(), (FOLDER / example["result"]).read_bytes()
    source, result = load_asset(data).surface, load_asset(made).surface
    np.testing.assert_array_equal(result.triangles, source.triangles)
    assert result.positions.shape == source.positions.shape
    moved = np.linalg.norm(result.positions - source.positions, axis=1)
    assert np.sqrt((moved**2).mean()) > 0.02 * np.linalg.norm(np.ptp(source.positions, axis=0))
    for region in example["document"]["params"].get("control", {}).get("regions", []):
        low, high = region["box"]["min"], region["box"]["max"]
        inside = ((source.positions >= low) & (source.positions <= high)).all(1)
        kept = np.unique(source.triangles[inside[source.triangles].all(1)])
        assert len(kept) > 100
        assert not moved[kept].any()
    _check_request(example)
    _check_picture(example)


def _check_request(example: dict[str, Any]) -> None:
    request = JobRequest.model_validate(example["document"])
    params = resolve(request.params)
    said = recorded((FOLDER / example["result"]).read_bytes())
    assert {name: said[name] for name in ("prompt", "seed", "preset", "step")} == {
        "prompt": request.prompt,
        "seed": params.seed,
        "preset": params.preset.value,
        "step": params.steps,
    }
    assert said["source_sha256"] == sha256_hex((FOLDER / example["asset"]).read_bytes())
    assert example["report"]["quality"]["flipped_faces"] == 0
    assert example["report"]["likeness"]["matches"] is True


def _check_picture(example: dict[str, Any]) -> None:
    """It has both side by side."""
    picture = Image.open(io.BytesIO((FOLDER / example["picture"]).read_bytes()))
    assert (picture.format, picture.width) == ("WEBP", 2 * picture.height)
    pixels = np.asarray(picture.convert("RGB"), dtype=np.int16)
    halves = pixels[:, : picture.height], pixels[:, picture.height :]
    assert np.abs(halves[0] - halves[1]).max() > 60
    assert min(half.std() for half in halves) > 5
