"""What the package requires: everything that it imports, and nothing under a copyleft or non-commercial licence."""

from __future__ import annotations

import ast
import importlib.metadata as metadata
import os
import sys
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from release.licences import dependencies, forbidden, licence
from tests.cases import each_case


def test_nothing_that_ships_is_copyleft_or_non_commercial() -> None:
    names = sorted(dependencies("all").keys() - {"meshdeform"})
    assert len(names) > 40
    assert {name: text for name in names if forbidden(text := licence(name))} == {}
    assert [name for name in names if not licence(name)] == []


def declared(repository: Path, *, dev: bool) -> set[str]:
    """Return the distributions, by canonical name, that pyproject.toml names itself."""
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"]]
    for extra, more in project["optional-dependencies"].items():
        lines += more if dev or extra != "dev" else []
    return {canonicalize_name(Requirement(line).name) for line in lines}


@each_case(
    ("folders", "dev"),
    [
        (("meshdeform", "service", "worker"), False),
        (("training", "tests", "bench", "docs", "examples", "release"), True),
    ],
    ids=["shipped", "development"],
)
def test_every_import_is_a_declared_requirement(folders: tuple[str, ...], dev: bool, repository: Path) -> None:
    known, providers = declared(repository, dev=dev), _providers()
    undeclared = {
        f"{path.relative_to(repository)}: {name}"
        for folder in folders
        for path, name in _third_party_imports(repository / folder)
        if not {canonicalize_name(provider) for provider in providers.get(name, [])} & known
    }
    assert undeclared == set()


@cache
def _providers() -> Mapping[str, list[str]]:
    """Return the distributions of each module; it reads the list of files of every one of them."""
    return metadata.packages_distributions()


def _own_files(folder: Path) -> Iterator[Path]:
    """Find the Python files, without reading through what the scripts install beside the tests."""
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name != "node_modules" and not name.startswith(".")]
        yield from (Path(place, name) for name in names if name.endswith(".py"))


def _third_party_imports(folder: Path) -> Iterator[tuple[Path, str]]:
    ours = {"meshdeform", "service", "worker", "training", "tests", "bench", "docs", "release"}
    for path in sorted(_own_files(folder)):
        for node in ast.walk(ast.parse(path.read_text())):
            modules = []
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                modules = [node.module or ""]
            for name in {module.partition(".")[0] for module in modules}:
                if name not in ours and name not in sys.stdlib_module_names:
                    yield path, name
