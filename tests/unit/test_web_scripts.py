"""The page's scripts that need no browser: the tests of tests/web, as `node --test` runs them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.requests.document import JobRequest, resolve
from meshdeform.runs.base import sha256_hex
from tests.cases import each_case
from tests.unit.assets.builders import unpack

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
    found = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


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
    panel = (WEB / "app/create/asset-panel.js").read_text(encoding="utf-8")
    named += [f"web/examples/{name}" for name in re.findall(r'name: "(\w+\.glb)"', panel)]
    assert len(named) > 8
    for name in named:
        assert (WEB / name.removeprefix("web/")).is_file(), name
    for path in sorted((WEB / "style").glob("*.css")):
        for name in re.findall(r'url\("([^"]+)"\)', path.read_text(encoding="utf-8")):
            assert (path.parent / name).is_file(), name


VENDOR = ROOT / "service" / "web" / "vendor"


def test_the_vendored_files_are_those_of_the_manifest_and_nothing_is_copyleft() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "vendor-web"), "--check", "--folder", str(VENDOR)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stdout
    manifest = json.loads((VENDOR / "manifest.json").read_text())
    licences = {package["license"] for package in manifest["packages"]}
    licences |= {entry["license"] for entry in manifest["files"].values() if "license" in entry}
    assert licences == {"MIT", "Apache-2.0", "MIT AND BSD-3-Clause"}


FOLDER = WEB / "examples"
EXAMPLES: list[dict[str, Any]] = json.loads((FOLDER / "gallery.json").read_text())["examples"]


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
    request = JobRequest.model_validate(example["document"])
    said = unpack(made)[0]["asset"]["extras"]["meshdeform"]
    assert (said["prompt"], said["seed"]) == (request.prompt, resolve(request.params).seed)
    assert request.params.kind == "exemplar"
    assert "preset" not in request.params.model_fields_set
    assert said["source_sha256"] == sha256_hex(data)
    assert example["report"]["quality"]["flipped_faces"] == 0
    assert example["report"].get("likeness", {"matches": True})["matches"] is True  # a change in plain words has none
