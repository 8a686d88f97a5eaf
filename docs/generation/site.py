"""Define hooks of MkDocs: pages and files of the site that are not in the docs folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

__all__ = ["on_files", "on_page_markdown"]

_ROOT = Path(__file__).resolve().parents[2]
_WEB = _ROOT / "service/web"
_SHARED = (
    "icons/meshdeform.svg",
    "style/fonts/instrument-sans-latin-wght-normal.woff2",
    "style/fonts/instrument-serif-latin-400-normal.woff2",
    "style/fonts/OFL-instrument-sans.txt",
    "style/fonts/OFL-instrument-serif.txt",
)


def on_files(files: Any, *, config: Any, **_: Any) -> Any:
    """Add the HTTP reference, and the icon and the fonts of the web page beside the site's style sheet."""
    sys.path.insert(0, str(_ROOT))  # MkDocs finds a hook by its path, and nothing beside it
    from docs.generation import http

    files.append(File.generated(config, "http_reference.md", content=http.page()))
    for name in _SHARED:
        source = _WEB / name
        files.append(File.generated(config, f"style/{source.name}", abs_src_path=str(source)))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Insert the changelog, which is outside the docs folder, into its page."""
    if page.file.src_uri != "changes.md":
        return markdown
    return (
        (Path(page.file.abs_src_path).parents[1] / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")
    )
