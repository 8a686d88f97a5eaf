"""List the dependencies of Meshdeform and check their licences.

Licences that impose conditions on the whole work (GPL, AGPL, LGPL) or forbid commercial use are not accepted;
file-level copyleft (MPL), which does not affect other files, is.
"""

from __future__ import annotations

import importlib.metadata as metadata
import re

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

__all__ = ["dependencies", "forbidden", "licence"]

_FORBIDDEN = re.compile(r"\b[AL]?GPL|General Public|\bSSPL|CC-BY-(NC|SA)|non-?commercial", re.IGNORECASE)
# These exceptions permit the run-time libraries in compiled wheels.
_EXCEPTION = re.compile(r"[AL]?GPL[\w.+-]* WITH (GCC-exception|Autoconf-exception|Bootloader-exception)[\w.-]*")


def dependencies(extra: str, name: str = "meshdeform") -> dict[str, set[str]]:
    """Return every distribution that `name[extra]` needs in this environment, including itself.

    Parameters
    ----------
    extra : str
        An extra of the distribution `name`; "" for none.

    Returns
    -------
    The canonical names of each one's direct dependencies, by its canonical name. Dependencies for another platform or
    Python, which are not installed, are left out.
    """
    found: dict[str, set[str]] = {}
    done: set[tuple[str, str]] = set()
    todo = [(canonicalize_name(name), extra)]
    while todo:
        current, chosen = todo.pop()
        if (current, chosen) in done:
            continue
        done.add((current, chosen))
        try:
            lines = metadata.requires(current) or []
        except metadata.PackageNotFoundError:
            continue
        needed = found.setdefault(current, set())
        for requirement in map(Requirement, lines):
            if requirement.marker is None or requirement.marker.evaluate({"extra": chosen}):
                wanted = canonicalize_name(requirement.name)
                needed.add(wanted)
                todo += [(wanted, ""), *((wanted, also) for also in requirement.extras)]
    return {current: {other for other in needed if other in found} - {current} for current, needed in found.items()}


def licence(name: str) -> str:
    """Return the most precise statement of a distribution about its licence, or "".

    Raises
    ------
    importlib.metadata.PackageNotFoundError
        The distribution is not installed.
    """
    meta = metadata.metadata(name)
    classifiers = [line for line in meta.get_all("Classifier") or [] if line.startswith("License ::")]
    said = {key: meta[key] for key in ("License-Expression", "License") if key in meta}
    return said.get("License-Expression") or "; ".join(classifiers) or said.get("License") or ""


def forbidden(text: str) -> bool:
    """Return whether a licence statement names a licence that is not accepted."""
    return bool(_FORBIDDEN.search(_EXCEPTION.sub("", text)))
