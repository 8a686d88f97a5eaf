"""What the package requires: everything that it imports, and nothing under a copyleft or non-commercial licence."""

from __future__ import annotations

import ast
import importlib.metadata as metadata
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

# File-level copyleft (MPL) asks nothing of the files beside it and is accepted; these ask it of the whole work.
# A GCC exception takes that demand back for the run-time libraries that compiled wheels carry.
COPYLEFT = re.compile(r"\b[AL]?GPL|General Public|\bSSPL|CC-BY-(NC|SA)|non-?commercial", re.IGNORECASE)
EXCEPTION = re.compile(r"[AL]?GPL[\w.+-]* WITH (GCC-exception|Autoconf-exception|Bootloader-exception)[\w.-]*")


def closure(extra: str) -> set[str]:
    """Return the distributions, by canonical name, that `meshdeform[extra]` needs on this machine."""
    found: set[tuple[str, str]] = set()
    todo = [("meshdeform", extra)]
    while todo:
        name, chosen = todo.pop()
        if (name, chosen) in found:
            continue
        found.add((name, chosen))
        try:
            lines = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue  # a requirement for another platform or Python
        for requirement in map(Requirement, lines):
            if requirement.marker is None or requirement.marker.evaluate({"extra": chosen}):
                wanted = canonicalize_name(requirement.name)
                todo += [(wanted, ""), *((wanted, also) for also in requirement.extras)]
    return {name for name, _ in found}


def licence(name: str) -> str:
    """Return what a distribution says of its licence, the most exact statement that it makes."""
    meta = metadata.metadata(name)
    classifiers = [line for line in meta.get_all("Classifier") or [] if line.startswith("License ::")]
    return meta.get("License-Expression") or "; ".join(classifiers) or meta.get("License") or ""


def test_nothing_that_ships_is_copyleft_or_non_commercial() -> None:
    names = sorted(name for name in closure("all") if name != "meshdeform" and _installed(name))
    assert len(names) > 40
    offending = {name: text for name in names if COPYLEFT.search(EXCEPTION.sub("", text := licence(name)))}
    assert offending == {}
    assert [name for name in names if not licence(name)] == []


@pytest.mark.parametrize("text", ["LGPL-3.0-only", "GNU General Public License v2", "CC-BY-NC-4.0", "AGPL-3.0"])
def test_the_licence_test_finds_what_it_looks_for(text: str) -> None:
    assert COPYLEFT.search(EXCEPTION.sub("", text))


def declared(repository: Path, *, dev: bool) -> set[str]:
    """Return the distributions, by canonical name, that pyproject.toml names itself."""
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"]]
    for extra, more in project["optional-dependencies"].items():
        lines += more if dev or extra != "dev" else []
    return {canonicalize_name(Requirement(line).name) for line in lines}


@pytest.mark.parametrize(
    ("folders", "dev"),
    [(("meshdeform", "service", "worker"), False), (("tests", "bench", "docs", "examples"), True)],
    ids=["shipped", "development"],
)
def test_every_import_is_a_declared_requirement(folders: tuple[str, ...], dev: bool, repository: Path) -> None:
    known, providers = declared(repository, dev=dev), metadata.packages_distributions()
    undeclared = {
        f"{path.relative_to(repository)}: {name}"
        for folder in folders
        for path, name in _third_party_imports(repository / folder)
        if not {canonicalize_name(provider) for provider in providers.get(name, [])} & known
    }
    assert undeclared == set()


def _installed(name: str) -> bool:
    try:
        metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def _third_party_imports(folder: Path) -> Iterator[tuple[Path, str]]:
    ours = {"meshdeform", "service", "worker", "tests", "bench"}
    for path in sorted(path for path in folder.rglob("*.py") if not {"node_modules", ".swift"} & set(path.parts)):
        for node in ast.walk(ast.parse(path.read_text())):
            modules = []
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                modules = [node.module or ""]
            for name in {module.partition(".")[0] for module in modules}:
                if name not in ours and name not in sys.stdlib_module_names:
                    yield path, name
