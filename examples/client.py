"""Deform an asset with a running service (`meshdeform serve`) and show the progress on one line.

    python examples/client.py examples/sphere.glb "a mushroom" mushroom

The service's address and key come from MESHDEFORM_URL and MESHDEFORM_API_KEY.
"""

from __future__ import annotations

import argparse
import sys

from meshdeform import Client, MeshdeformError
from meshdeform.client import EventView


def show(event: EventView) -> None:
    """Print the progress, and at last how the job ended."""
    if event.type == "progress":
        print(f"\r{event.data['fraction']:4.0%} {event.data['phase']}", end="", file=sys.stderr, flush=True)
    elif event.type.terminal:
        print(f"\r{event.type}          ", file=sys.stderr)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("asset")
    parser.add_argument("prompt")
    parser.add_argument("folder")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    params = {"seed": options.seed}
    try:
        with Client() as client:
            result = client.deform(options.asset, options.prompt, params=params, on_event=show)
            for path in result.save(options.folder):
                print(path)
    except MeshdeformError as error:
        print(f"{error.code}: {error.detail} {error.advice}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
