"""Count the house: ``python -m bench.house [--write]``.

Lines of the product's Python, of the families of shapes with their tables, of what trains and measures, of the page, of
tests and of benchmarks; words of documents, those that people wrote and those made from the code; what makes code hard
to read (`code_shape.py`); parameters of `text_deform`. Libraries of others and generated files
(`_OF_OTHERS`) are left out. ``bench/house.json`` holds the counts: a change that adds more than `ROOM` lines or a
parameter changes that file as well, so that it is seen (`tests/unit/test_house.py`), and says who uses it.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
from pathlib import Path

from bench.code_shape import counted
from meshdeform.requests.groups import GROUPS

__all__ = ["EXPECTED", "ROOM", "counts"]

ROOT = Path(__file__).resolve().parents[1]
_GENERATED_PAGES = ("docs/extensions.md", "docs/nouns.md", "docs/parameters.md")
_GENERATED_PARTS = re.compile(r"^<!-- from .*?^<!-- until here -->$", re.DOTALL | re.MULTILINE)
"""What `docs/generate.py` writes into pages that people write."""
EXPECTED = Path(__file__).with_suffix(".json")
ROOM = 500
"""Lines, and words, that a change may add without a change of the counts."""
_THEIR_TESTS = ":(exclude,glob)integrations/*/tests/**"
_FAMILIES = "meshdeform/nouns/families"
_PRODUCT = ["meshdeform", "service", "worker", "clients", "integrations", "plugins", f":(exclude){_FAMILIES}"]
_FOLDERS = {
    "product": ([*_PRODUCT, _THEIR_TESTS], (".py",)),
    "families": ([_FAMILIES], (".py", ".txt")),
    "training": (["training"], (".py",)),
    "page": (["service/web"], (".js", ".css", ".html")),
    "tests": (["tests", ":(glob)integrations/*/tests/**"], (".py",)),
    "bench": (["bench"], (".py",)),
}
_CODE = ["meshdeform", "service", "worker"]
_OF_OTHERS = ("service/web/vendor/", "service/web/client/", "meshdeform/client/sync/")
"""Libraries, and what is generated: the page's client of `clients/typescript`, and the client for threads, of
`meshdeform/client/asynchronous`."""


def counts() -> dict[str, int]:
    """Return the counts of the files that git knows."""
    lines = {
        f"{name}_lines": sum(_text(path).count("\n") for path in _files(folders) if path.endswith(endings))
        for name, (folders, endings) in _FOLDERS.items()
    }
    pages = [path for path in _files(["docs", "README.md"]) if path.endswith(".md")]
    words = sum(len(_text(path).split()) for path in pages)
    written = sum(len(_written(path).split()) for path in pages)
    return {
        **lines,
        **counted({path: _text(path) for path in _files(_CODE) if path.endswith(".py")}),
        "document_words": written,
        "generated_document_words": words - written,
        "parameters": len(GROUPS),
    }


def _written(path: str) -> str:
    """Return what of a page people wrote."""
    return "" if path in _GENERATED_PAGES else _GENERATED_PARTS.sub("", _text(path))


def _files(folders: list[str]) -> list[str]:
    command = ["git", "ls-files", "--", *folders]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
    return [path for path in listed if not path.startswith(_OF_OTHERS) and (ROOT / path).is_file()]


def _text(path: str) -> str:
    return (ROOT / path).read_text()


def main() -> None:
    """Print the counts; with ``--write``, keep them."""
    parser = argparse.ArgumentParser(description="Count the house.")
    parser.add_argument("--write", action="store_true", help="keep the counts in house.json")
    document = json.dumps(counts(), indent=2) + "\n"
    if parser.parse_args().write:
        EXPECTED.write_text(document)
    print(document, end="")


if __name__ == "__main__":
    main()
