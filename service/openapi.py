"""Write the OpenAPI document of the service, which `documentation.responses` builds.

python -m service.openapi            write openapi/openapi.json
python -m service.openapi --check    fail if the committed document is outdated
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from service.app import create_app


def text() -> str:
    """Return the document in the form in which it is committed."""
    return json.dumps(create_app().openapi(), indent=2, ensure_ascii=False) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Write or compare `openapi/openapi.json`."""
    parser = argparse.ArgumentParser(prog="python -m service.openapi", description=main.__doc__)
    parser.add_argument("--check", action="store_true", help="compare and do not write")
    parser.add_argument("--path", type=Path, default=Path(__file__).parent.parent / "openapi" / "openapi.json")
    options = parser.parse_args(arguments)
    document = text()
    if not options.check:
        options.path.parent.mkdir(exist_ok=True)
        options.path.write_text(document, encoding="utf-8")
        return 0
    if options.path.is_file() and options.path.read_text(encoding="utf-8") == document:
        return 0
    print(f"{options.path} is outdated. Run: python -m service.openapi", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
