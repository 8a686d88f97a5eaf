"""Measure what a new user needs to get a first picture: commands, seconds, megabytes and words.

    python bench/first_minute.py                   # the committed state
    python bench/first_minute.py 42f77fb HEAD      # two revisions, alternating, and the ratio of the second to the
    first

Each revision is cloned into an empty folder, with an empty home and without caches, and the first command of README is
run unchanged. It counts:

* commands: the clone, and the lines of README's first block up to the one that makes the picture;
* seconds: from the start of the first command to the picture, without the clone; also processor seconds, which depend
  less on other work on the machine;
* megabytes: additional disk space, without the clone;
* words: those of README up to the end of that line, and all output of the command.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_FIRST_BLOCK = re.compile(r"```sh\n(.*?)```", re.DOTALL)
_KEPT = ("PATH", "LANG", "TMPDIR", "SSL_CERT_FILE", "PIP_INDEX_URL", "PIP_FIND_LINKS", "PIP_CERT", "PIP_CONFIG_FILE")


@dataclass
class Count:
    """Counts for one revision."""

    commands: int
    seconds: float
    processor_seconds: float
    megabytes: float
    words: int


def first_minute(revision: str, folder: Path) -> Count:
    """Clone, follow README's first command, and count."""
    clone, home = folder / "meshdeform", folder / "home"
    home.mkdir(parents=True)
    subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
    subprocess.run(["git", "-C", str(clone), "checkout", "-q", revision], check=True)
    text = (clone / "README.md").read_text()
    block = _FIRST_BLOCK.search(text)
    if block is None:
        raise SystemExit(f"{revision}: README has no commands")
    line = block.group(1).splitlines()[0]
    read = text[: block.start(1) + len(line)]
    before_mb, before_s = _megabytes(folder), _children_s()
    environment = {name: os.environ[name] for name in _KEPT if name in os.environ}
    environment |= {"HOME": str(home), "PIP_NO_CACHE_DIR": "1", "UV_NO_CACHE": "1"}
    start = time.perf_counter()
    done = subprocess.run(
        ["bash", "-c", line], cwd=clone, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    seconds = time.perf_counter() - start
    if done.returncode:
        raise SystemExit(f"{revision}: {line} ended with {done.returncode}\n{done.stderr}")
    if not [path for path in clone.glob("*.png") if path.stat().st_mtime >= time.time() - seconds - 1]:
        raise SystemExit(f"{revision}: {line} made no picture")
    return Count(
        commands=2,
        seconds=round(seconds, 1),
        processor_seconds=round(_children_s() - before_s, 1),
        megabytes=round(_megabytes(folder) - before_mb),
        words=_words(read) + _words(done.stdout) + _words(done.stderr),
    )


def _words(text: str) -> int:
    return len(text.split())


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _megabytes(folder: Path) -> float:
    return sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir()) / 1e6


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revisions", nargs="*", default=["HEAD"])
    revisions = parser.parse_args().revisions
    counts = []
    for revision in revisions:
        with tempfile.TemporaryDirectory() as folder:
            counts.append(first_minute(revision, Path(folder)))
        print(f"{revision}: {asdict(counts[-1])}", flush=True)
    if len(counts) == 2:
        old, new = (asdict(count) for count in counts)
        print("ratio:", {name: round(new[name] / old[name], 2) for name in old})


if __name__ == "__main__":
    sys.exit(main())
