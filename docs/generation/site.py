"""Define hooks of MkDocs that process pages of the site."""

from __future__ import annotations

from pathlib import Path
from typing import Any

__all__ = ["on_page_markdown"]


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Insert the changelog, which is outside the docs folder, into its page."""
    if page.file.src_uri != "changes.md":
        return markdown
    return (
        (Path(page.file.abs_src_path).parents[1] / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")
    )
