"""``python -m tests.toolchain.write_results FOLDER``: results and morphs of the assets here, for Blender to read."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.toolchain.assets import ASSETS
from tests.toolchain.deformed import deformed

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for name, make in ASSETS.items():
        artifacts = deformed(make())
        for kind in ("result", "morph"):
            (folder / f"{name}-{kind}.glb").write_bytes(artifacts[f"{kind}.glb"])
