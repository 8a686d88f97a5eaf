"""A kind of job is a folder of `meshdeform/kinds`: without the folder there is no such kind, and all else is there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cases import each_case

ROOT = Path(__file__).resolve().parents[2]

# Describes the service, the command line and the kinds. That nothing imports a kind, `lint-imports` says.
_LOOK = """
import json
from meshdeform.cli.app import app
from meshdeform.requests.choices import JobKind
from meshdeform.runs import kinds
from service.app import create_app
import worker.supervisor
assert [kind.name for kind in kinds()] == list(JobKind)
print(json.dumps({
    "kinds": list(JobKind),
    "paths": [*create_app().openapi()["paths"]],
    "commands": [each.callback.__name__ for each in app.registered_commands],
    "groups": [each.name for each in app.registered_groups],
}))
"""

BRINGS = {
    "families": {"kinds": {"family_fit", "family_synthesize"}, "commands": {"family_fit", "family_synthesize"}},
    "sketch": {"paths": {"/v1/sketches:guess", "/v1/sketches:mesh"}, "commands": {"sketch"}},
    "surface_fit": {"kinds": {"surface_fit"}, "commands": {"surface_fit", "unfold"}},
    "words": {
        "paths": {"/v1/words", "/v1/words/{noun}", "/v1/words/{noun}/content", "/v1/words/{noun}/picture.png"},
        "groups": {"words"},
    },
}
"""What is there because of each folder."""


def without(folder: Path, kind: str) -> Path:
    """Return a folder with the packages of the product, without one kind."""
    kinds = folder / "meshdeform" / "kinds"
    kinds.mkdir(parents=True)
    for package in ("service", "worker"):
        (folder / package).symlink_to(ROOT / package)
    product = ROOT / "meshdeform"
    for path in (*product.iterdir(), *(product / "kinds").iterdir()):
        if path.name != "__pycache__" and path not in (product / "kinds", product / "kinds" / kind):
            (folder / path.relative_to(ROOT)).symlink_to(path)
    return folder


def found(code: str, folder: Path) -> str:
    """Return what a fresh Python prints that has the packages of this folder."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    ran = subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_every_kind_is_a_folder() -> None:
    kinds = ROOT / "meshdeform" / "kinds"
    assert {path.parent.name for path in kinds.glob("*/__init__.py")} == set(BRINGS)


@pytest.fixture(scope="module")
def whole() -> dict[str, list[str]]:
    """What there is with all kinds."""
    there: dict[str, list[str]] = json.loads(found(_LOOK, ROOT))
    return there


@each_case("kind", BRINGS)
def test_without_its_folder_a_kind_is_gone_and_all_else_is_there(
    kind: str, whole: dict[str, list[str]], tmp_path: Path
) -> None:
    less = json.loads(found(_LOOK, without(tmp_path / kind, kind)))
    gone = {name: set(whole[name]) - set(less[name]) for name in whole}
    assert gone == {name: BRINGS[kind].get(name, set()) for name in whole}
