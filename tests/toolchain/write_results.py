"""``python -m tests.toolchain.write_results FOLDER``: results of the assets here in all formats, for Blender."""

from __future__ import annotations

import sys
from pathlib import Path

from meshdeform.assets import load_asset
from meshdeform.assets.export import export
from tests.toolchain.assets import ASSETS
from tests.toolchain.deformed import deformed

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for name, make in ASSETS.items():
        artifacts = deformed(make())
        for kind in ("result", "morph"):
            (folder / f"{name}-{kind}.glb").write_bytes(artifacts[f"{kind}.glb"])
        result = load_asset(artifacts["result.glb"])
        for ending in ("usdz", "obj", "stl"):
            for file, data in export(result, f"{name}-result.{ending}").files.items():
                (folder / file).parent.mkdir(exist_ok=True)
                (folder / file).write_bytes(data)
