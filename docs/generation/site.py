"""Define hooks of MkDocs: pages and files of the site that are not in the docs folder."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

__all__ = ["on_files", "on_page_markdown", "on_post_build"]

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
    """Add the references of HTTP, commands and equations, and the page's icon and fonts beside the style sheet."""
    sys.path.insert(0, str(_ROOT))  # MkDocs finds a hook by its path, and nothing beside it
    from docs.generation import cli, equations, http

    files.append(File.generated(config, "http_reference.md", content=http.page()))
    files.append(File.generated(config, "cli_reference.md", content=cli.page()))
    files.append(File.generated(config, "equations.md", content=equations.page()))
    for name in _SHARED:
        source = _WEB / name
        files.append(File.generated(config, f"style/{source.name}", abs_src_path=str(source)))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Insert the changelog, the README of the TypeScript client, and recipes, which are outside the docs folder."""
    if page.file.src_uri == "changes.md":
        changelog = (_ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
        return changelog.replace("](docs/", "](") + markdown.partition("\n")[2]
    if page.file.src_uri == "typescript.md":
        readme = (_ROOT / "clients/typescript/README.md").read_text(encoding="utf-8")
        return markdown[: markdown.rindex("[The package's README]")] + readme[readme.index("```ts") :]
    return re.sub(r"^<!-- file: (\S+) -->$", lambda found: _shown(_ROOT / found[1]), markdown, flags=re.MULTILINE)


def _shown(path: Path) -> str:
    language = path.suffix.lstrip(".") or "sh"
    return f"```{language}\n{path.read_text(encoding='utf-8')}```"


def on_post_build(*, config: Any, **_: Any) -> None:
    """Write `llms.txt` (llmstxt.org): the pages, each with its first sentence."""
    lines = [f"# {config.site_name}", "", f"> {config.site_description}"]
    docs = Path(config.docs_dir)
    for entry in config.nav:
        for section, pages in entry.items() if isinstance(entry, dict) else [("", [entry])]:
            lines += ["", f"## {section}", ""] if section else [""]
            lines += [_listed(docs / page) for page in pages if (docs / page).is_file()]
    (Path(config.site_dir) / "llms.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _listed(page: Path) -> str:
    title, _, text = page.read_text(encoding="utf-8").partition("\n")
    paragraphs = (part for part in text.split("\n\n") if part.strip() and part.strip()[0].isalnum())
    first = " ".join(next(paragraphs, "").split())
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", first)
    sentence = re.split(r"(?<=[.:])\s", plain, maxsplit=1)[0]
    return f"- [{title.lstrip('# ')}]({page.stem}.html): {sentence}".rstrip(": ")
