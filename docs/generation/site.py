"""Define hooks of MkDocs that process pages of the site."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

__all__ = ["on_files", "on_page_markdown"]

_WEB = Path(__file__).resolve().parents[2] / "service/web"
_SHARED = (
    "icons/meshdeform.svg",
    "style/fonts/instrument-sans-latin-wght-normal.woff2",
    "style/fonts/instrument-serif-latin-400-normal.woff2",
    "style/fonts/OFL-instrument-sans.txt",
    "style/fonts/OFL-instrument-serif.txt",
)


def on_files(files: Any, *, config: Any, **_: Any) -> Any:
    """Add the icon and the fonts of the web page to the site, beside its style sheet."""
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
