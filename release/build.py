"""Build a release: source distribution, wheel, package of the TypeScript client, bill of materials, checksums.

    python -m release.build                  # into dist/
    python -m release.build --out somewhere

The wheel is built from the source distribution, so files missing from that are noticed. The same commit gives the same
bytes (SOURCE_DATE_EPOCH is the commit's date). A release with missing or unexpected files is refused.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from fnmatch import fnmatch
from pathlib import Path

from meshdeform import __version__
from release.typescript import packed

__all__ = ["MAX_WHEEL_BYTES", "NEEDED", "build", "main", "wrong_with"]

_ROOT = Path(__file__).resolve().parents[1]

NEEDED = (
    "meshdeform/py.typed",
    "meshdeform/priors/builtin/weights/*.safetensors",
    "meshdeform/vocabulary/near_nouns.txt.gz",
    "meshdeform/vocabulary/translations.txt",
    "meshdeform/judge/weights/*",
    "meshdeform/record/migrations/versions/*.py",
    "service/web/index.html",
    "service/web/app/*.js",
    "service/web/style/*.css",
    "service/web/viewer/viewer.js",
    "service/web/client/index.js",
    "service/web/vendor/manifest.json",
    "service/web/vendor/three/LICENSE",
    "service/web/vendor/three/three.module.js",
    "service/web/examples/*.glb",
    "service/web/examples/*.zip",
    "service/web/examples/*.ndf",
    "service/web/examples/*.png",
    "service/web/vendor/gifenc/*",
    "service/web/examples/gallery.json",
    "service/web/examples/gallery/*.glb",
    "service/web/examples/gallery/*.webp",
    "*.dist-info/licenses/LICENSE",
    "*.dist-info/licenses/NOTICE",
    "*.dist-info/entry_points.txt",
)
"""Required contents of a wheel, as patterns of file names."""

_ALLOWED = ("meshdeform/*", "service/*", "worker/*", "*.dist-info/*")
_STRAY = ("*.pyc", "*__pycache__*", "*.log", "*.db", "*.orig", "*/node_modules/*", "*.map")
MAX_WHEEL_BYTES = 18_000_000
"""Upper limit of the wheel's size; the prior and the page take most of it."""


def build(out: Path) -> list[Path]:
    """Build all files of a release into a folder.

    Parameters
    ----------
    out : Path
        Created if missing.

    Returns
    -------
    The files: source distribution, wheel, package of the TypeScript client, bill of materials, checksums.

    Raises
    ------
    SystemExit
        The wheel has missing or unexpected contents, or the client cannot be packed; nothing is left in `out`.
    """
    out.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "SOURCE_DATE_EPOCH": _moment()}
    with tempfile.TemporaryDirectory(dir=out) as aside:
        command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", aside, str(_ROOT)]
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
        wheel = next(Path(aside).glob("*.whl"))
        wrong = wrong_with(wheel)
        if wrong:
            raise SystemExit("release/build.py: the wheel has wrong contents:\n" + "\n".join(wrong))
        bill = Path(aside) / f"meshdeform-{__version__}.cdx.json"
        command = [sys.executable, "-m", "release.sbom", "-o", str(bill)]
        subprocess.run(command, check=True, env=environment, cwd=_ROOT)
        packed(Path(aside))
        files = sorted(path for path in Path(aside).iterdir() if path.suffix in {".whl", ".gz", ".json", ".tgz"})
        sums = Path(aside) / "SHA256SUMS"
        sums.write_text("".join(f"{_sha256(path)}  {path.name}\n" for path in files))
        return [path.replace(out / path.name) for path in [*files, sums]]


def wrong_with(wheel: Path) -> list[str]:
    """Return a description of everything that a wheel lacks or has in excess; empty if it is correct."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    wrong = [f"lacks {pattern}" for pattern in NEEDED if not any(fnmatch(name, pattern) for name in names)]
    wrong += [f"has {name}, which belongs nowhere" for name in names if not _any(name, _ALLOWED)]
    wrong += [f"has {name}, which was left behind" for name in names if _any(name, _STRAY)]
    if (size := wheel.stat().st_size) > MAX_WHEEL_BYTES:
        wrong.append(f"has {size:,} bytes, more than {MAX_WHEEL_BYTES:,}")
    return wrong


def _any(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatch(name, pattern) for pattern in patterns)


def _moment() -> str:
    """Return the commit's time in seconds since 1970, which files in archives get."""
    if "SOURCE_DATE_EPOCH" in os.environ:
        return os.environ["SOURCE_DATE_EPOCH"]
    done = subprocess.run(["git", "log", "-1", "--format=%ct"], cwd=_ROOT, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def main() -> None:
    """Build a release and print its files."""
    parser = argparse.ArgumentParser(description="Build a release.")
    parser.add_argument("--out", type=Path, default=_ROOT / "dist", help="folder to put the files into (default: dist)")
    for path in build(parser.parse_args().out):
        print(f"{path.stat().st_size:>12,}  {path}")


if __name__ == "__main__":
    main()
