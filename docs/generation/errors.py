"""Generate the list in docs/errors.md: every code with its status, its meaning and its advice."""

from __future__ import annotations

import meshdeform.errors
from docs.generation.between import renewed
from meshdeform.errors import MeshdeformError

__all__ = ["page"]


def page(text: str) -> str:
    """Return docs/errors.md with its list of codes regenerated."""
    found = {each.code: each for each in vars(meshdeform.errors).values() if _is_error(each)}
    parts = [_section(code, error) for code, error in sorted(found.items())]
    return renewed(text, "meshdeform/errors.py", "\n".join(parts))


def _is_error(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, MeshdeformError)


def _section(code: str, error: type[MeshdeformError]) -> str:
    return f"### {code}\n\n{error.status}. {' '.join((error.__doc__ or '').split())} {' '.join(error.advice.split())}\n"
