"""Say which meshes of a folder can be fitted at the default, why others are refused, and the CPU seconds until then.

python -m bench.surface_models FOLDER                   # reads each, and makes its base
python -m bench.surface_models FOLDER --fits FITS       # with the reports of `meshdeform surface-fit` that lie in FITS
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from meshdeform.assets import load_asset
from meshdeform.errors import AssetError
from meshdeform.kinds.surface_fit.base_mesh import base_of
from meshdeform.kinds.surface_fit.cleaning import clean
from meshdeform.requests.surface_fit import SurfaceFitParams


def row(path: Path, fits: Path | None) -> str:
    """Return a row of the table."""
    begin, data = time.process_time(), path.read_bytes()
    try:
        surface = load_asset(data, path.name).surface
        mesh = clean(surface.positions, surface.triangles)
        _, faces = base_of(mesh, SurfaceFitParams().base_faces)
    except AssetError as error:
        return f"| {path.stem} | refused: {error} | {time.process_time() - begin:.1f} |"
    known, spent = mesh.topology, time.process_time() - begin
    cells = [path.stem, len(mesh.faces), known.components, known.borders, known.genus, len(faces), f"{spent:.1f}"]
    report = fits and fits / f"{path.stem}.report.json"
    if report and report.exists():
        found = json.loads(report.read_text())
        far = found["levels"][-1]["distance"]
        cells += [found["result"]["bytes"]]
        cells += [f"{far['mean']:.3%}", f"{far['from_input']['max']:.2%}", far["reversed_faces"]]
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fits", type=Path)
    given = parser.parse_args()
    print("| mesh | faces | parts | borders | handles | base | CPU s | bytes | distance | farthest | reversed |")
    print("|---" * 11 + "|")
    for path in sorted(given.folder.iterdir()):
        print(row(path, given.fits), flush=True)


if __name__ == "__main__":
    main()
