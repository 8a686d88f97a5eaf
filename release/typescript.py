"""Pack the TypeScript client as npm publishes it."""

from __future__ import annotations

import json
import shutil
import subprocess
import tarfile
import tempfile
from pathlib import Path

from meshdeform import __version__

__all__ = ["packed"]

_ROOT = Path(__file__).resolve().parents[1]
_TOOLS = _ROOT / "tests/node/node_modules"
_NEEDED = {"package/package.json", "package/README.md", "package/dist/index.js", "package/dist/index.d.ts"}


def packed(out: Path) -> Path:
    """Build a copy of the client and pack it.

    The compiler is that of the tests where they are installed in the right versions; otherwise npm fetches it.

    Parameters
    ----------
    out : Path
        The folder for `meshdeform-VERSION.tgz`.

    Raises
    ------
    SystemExit
        npm is missing or fails, the package has another version, or it lacks a part.
    """
    npm = shutil.which("npm")
    if npm is None:
        raise SystemExit("release/build.py: npm is not installed; the TypeScript client is part of a release.")
    with tempfile.TemporaryDirectory() as aside:
        # At the same depth as in the repository: its scripts read ../../openapi.
        package = Path(aside) / "clients/typescript"
        ignored = shutil.ignore_patterns("node_modules", "dist", "schema.ts", "*.tgz")
        shutil.copytree(_ROOT / "clients/typescript", package, ignore=ignored)
        shutil.copytree(_ROOT / "openapi", Path(aside) / "openapi")
        about = json.loads((package / "package.json").read_text())
        if about["version"] != __version__:
            raise SystemExit(f"release/build.py: clients/typescript has version {about['version']}, not {__version__}.")
        if _has(about["devDependencies"]):
            (package / "node_modules").symlink_to(_TOOLS)
        else:
            _run([npm, "install", "--no-audit", "--no-fund"], package)
        _run([npm, "pack", "--pack-destination", str(out.resolve())], package)
    file = out / f"{about['name']}-{__version__}.tgz"
    with tarfile.open(file) as archive:
        lacking = _NEEDED - set(archive.getnames())
    if lacking:
        raise SystemExit(f"release/build.py: {file.name} lacks {', '.join(sorted(lacking))}.")
    return file


def _has(wanted: dict[str, str]) -> bool:
    """Return whether the tests' tools include these packages in exactly these versions."""
    found = {name: _TOOLS / name / "package.json" for name in wanted}
    return all(
        path.is_file() and json.loads(path.read_text())["version"] == wanted[name] for name, path in found.items()
    )


def _run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"release/build.py: {' '.join(command[1:3])} failed:\n{done.stdout}{done.stderr}")
