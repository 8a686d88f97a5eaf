"""Run one pair as a user does: `meshdeform run` in a process of its own, of this checkout or of another one.

A pair's folder has `result.glb`, `result.report.json`, `source.png`, `result.png`, and `record.json`: what was asked,
of which code, what it cost, and what the report says.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.keep.assets import Pair
from bench.keep.pictures import draw
from meshdeform.support.files import write_files

ROOT = Path(__file__).resolve().parents[2]
KINDS = ("exemplar", "sds")
CHILD = Path(__file__).with_name("child.py")
_LEFT_OUT = ("losses", "params", "input", "versions")
"""What a report has for every step or of every run alike."""


@dataclass(frozen=True)
class Code:
    """A checkout of the project."""

    folder: Path
    commit: str
    digest: str  # twelve digits of the SHA-256 of its package's modules, which may differ from the commit's

    @classmethod
    def of(cls, folder: Path) -> Code:
        """Return the code of a checkout."""
        asked = ["git", "-C", str(folder), "rev-parse", "--short=8", "HEAD"]
        commit = subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()
        every = hashlib.sha256()
        for path in sorted((folder / "meshdeform").rglob("*.py")):
            every.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
        return cls(folder, commit, every.hexdigest()[:12])


def ran(pair: Pair, path: Path, folder: Path, code: Code, kind: str | None) -> dict[str, Any]:
    """Return the record of a pair, from its folder if the same code has run it there, else of a run now.

    Parameters
    ----------
    pair : Pair
    path : Path
        The asset's file.
    folder : Path
        Where the pair's files go.
    code : Code
    kind : str, optional
        `guidance.kind` of the request; None leaves it out.
    """
    made = folder / "record.json"
    if made.exists():
        known: dict[str, Any] = json.loads(made.read_text())
        if known["digest"] == code.digest and known["kind"] == kind and known["problem"] is None:
            return known
    folder.mkdir(parents=True, exist_ok=True)
    record = {
        "asset": pair.asset.name,
        "split": pair.asset.split,
        "distance": pair.distance,
        "prompt": pair.prompt,
        "kind": kind,
        "commit": code.commit,
        "digest": code.digest,
        **measured(pair.prompt, path, folder, code, kind),
    }
    if record["problem"] is None:
        draw(path, folder / "result.glb", pair.asset.front or 0.0, folder)
    write_files({made: (json.dumps(record, indent=1) + "\n").encode()})
    return record


def command(prompt: str, path: Path, result: Path, kind: str | None) -> list[str]:
    """Return the command line of a run."""
    asked = [] if kind is None else ["--set", f"guidance.kind={kind}"]
    return [
        *(sys.executable, "-m", "meshdeform", "run", str(path.resolve()), prompt),
        *("--output", str(result.resolve()), "--json", "--quiet", "--force", *asked),
    ]


def measured(prompt: str, path: Path, folder: Path, code: Code, kind: str | None) -> dict[str, Any]:
    """Run a prompt on a file; return CPU and wall seconds, the most memory in MB, and the report or the problem.

    The result and what lies beside it are written into a folder that exists.
    """
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-I", str(CHILD), *command(prompt, path, folder / "result.glb", kind)],
        cwd=code.folder,
        env={**os.environ, "PYTHONPATH": str(code.folder)},
        check=True,
        capture_output=True,
        text=True,
    )
    cost = json.loads(done.stdout) | {"wall_seconds": round(time.perf_counter() - started, 2)}
    if failed := cost.pop("exit"):
        return {**cost, "problem": f"exit {failed}: {done.stderr.strip()[-500:]}", "report": None}
    report = json.loads((folder / "result.report.json").read_text())
    return {**cost, "problem": None, "report": {name: report[name] for name in report if name not in _LEFT_OUT}}


def verdict(record: Mapping[str, Any]) -> str:
    """Return what a run says of its own result: `good`, `doubtful`, `keep_source`, or `failed`."""
    if record["report"] is None:
        return "failed"
    value = str((record["report"].get("verdict") or {}).get("value", "none"))
    return {"keep_result": "doubtful"}.get(value, value)
