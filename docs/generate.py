"""Writes what of the documentation is made from the code: `python docs/generate.py`. A test compares.

* docs/parameters.md, from the models of a request;
* the files and artifacts in docs/http.md, from the kinds of job.

The references of HTTP and of commands are made when the site is built (docs/generation/site.py).
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # a script finds its own folder only

from docs.generation import kinds, parameters  # noqa: E402

__all__ = ["pages"]


def pages() -> dict[Path, str]:
    """Return what each generated page should hold now."""
    folder = ROOT / "docs"
    return {
        folder / "parameters.md": parameters.page(),
        folder / "http.md": kinds.page((folder / "http.md").read_text(encoding="utf-8")),
    }


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
