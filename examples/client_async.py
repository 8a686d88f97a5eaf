"""Deform one asset with several prompts at the same time, in one event loop.

python examples/client_async.py examples/sphere.glb out "a mushroom" "a vase" "a rocket"
"""

from __future__ import annotations

import argparse
import asyncio
from pathlib import Path

from meshdeform import AsyncClient, MeshdeformError
from meshdeform.client import UploadView


async def deform(client: AsyncClient, asset: UploadView, prompt: str, folder: Path, seed: int) -> str:
    """Run one job, save its results and return a line about it."""
    try:
        result = await client.deform(asset, prompt, params={"seed": seed})
        await result.save(folder / prompt.replace(" ", "_"))
    except MeshdeformError as error:
        return f"{prompt}: {error.code}: {error.detail}"
    return f"{prompt}: {folder / prompt.replace(' ', '_')}"


async def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("asset", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("prompts", nargs="+")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    async with AsyncClient() as client:
        # Upload once; every job refers to it.
        asset = await client.upload(options.asset)
        jobs = [deform(client, asset, prompt, options.folder, options.seed) for prompt in options.prompts]
        for line in asyncio.as_completed(jobs):
            print(await line)


if __name__ == "__main__":
    asyncio.run(main())
