"""Writes what of the documentation is made from the code: `python docs/generate.py`. A test compares.

* docs/parameters.md, from the models of a request, and docs/extensions.md, from the rules for extensions;
* parts of pages, between two comments: the settings in docs/configuration.md, the codes in docs/errors.md, the methods
  in docs/client.md, the commands and exit codes in docs/cli.md, the routes, and the files of each kind of job, in
  docs/http.md, a table in docs/plain.md, the layout of a file in docs/surface_fit.md, and the folders
  in docs/architecture.md;
* docs/pictures/architecture.svg, from the imports.

The references of HTTP, of commands and of equations are made when the site is built (docs/generation/site.py).
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # a script finds its own folder only

from docs.generation import (  # noqa: E402
    architecture,
    client,
    commands,
    errors,
    extensions,
    kinds,
    parameters,
    routes,
    settings,
    tables,
)

__all__ = ["pages"]


def pages() -> dict[Path, str]:
    """Return what each generated page should hold now."""
    folder = ROOT / "docs"
    found = {folder / "parameters.md": parameters.page(), folder / "extensions.md": extensions.page()}
    found[folder / "pictures" / "architecture.svg"] = architecture.picture()
    for name, renewals in _RENEWED.items():
        text = (folder / name).read_text(encoding="utf-8")
        for renew in renewals:
            text = renew(text)
        found[folder / name] = text
    return found


_RENEWED = {
    "architecture.md": (architecture.page,),
    "cli.md": (commands.page,),
    "client.md": (client.page,),
    "configuration.md": (settings.page,),
    "errors.md": (errors.page,),
    "http.md": (routes.page, kinds.page),
    "plain.md": (tables.plain,),
    "surface_fit.md": (tables.fields,),
}


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
