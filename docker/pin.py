"""Write docker/constraints.txt: the versions of this environment for all that the images install.

    .venv/bin/python docker/pin.py

torch is not among them: the worker's image takes it by its own build arguments, for the CPU or for CUDA.
"""

from __future__ import annotations

import importlib.metadata as metadata
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

EXTRAS = ("service", "worker", "sd", "otel", "usd")
HERE = Path(__file__).resolve().parent
HEAD = """\
# What the images install, to the version; `python docker/pin.py` writes this file from a tested environment.
# torch is chosen by the build arguments of docker/worker.Dockerfile, and names its own CUDA libraries exactly.
"""


def requirements(name: str) -> list[Requirement]:
    """Return what a distribution asks for; what this one asks for is in pyproject.toml, whatever is installed."""
    if name != "meshdeform":
        return [Requirement(line) for line in metadata.requires(name) or []]
    project = tomllib.loads((HERE.parent / "pyproject.toml").read_text())["project"]
    asked = [Requirement(line) for line in project["dependencies"]]
    for extra, lines in project["optional-dependencies"].items():
        asked += [Requirement(f'{line} ; extra == "{extra}"') for line in lines]
    return asked


def pins() -> dict[str, str]:
    """Return the version of every distribution that the images' extras need."""
    found: dict[str, str] = {}
    todo, seen = [("meshdeform", extra) for extra in EXTRAS], set[tuple[str, str]]()
    while todo:
        name, extra = todo.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            print(f"not installed here, so not pinned: {name}")
            continue
        for requirement in requirements(name):
            if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
                wanted = canonicalize_name(requirement.name)
                todo += [(wanted, ""), *((wanted, also) for also in requirement.extras)]
    return {name: found[name] for name in sorted(found) if name not in {"meshdeform", "torch"}}


if __name__ == "__main__":
    lines = [f"{name}=={version}\n" for name, version in pins().items()]
    (HERE / "constraints.txt").write_text(HEAD + "".join(lines))
