"""Shell completion, by really asking bash."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(sys.executable).with_name("meshdeform")


OFFERED = {
    "meshdeform ba": {"batch"},
    "meshdeform run x.glb --preset ": {"preview", "balanced", "paper"},
    "meshdeform run x.glb --model b": {"builtin"},
    "meshdeform jobs --state ca": {"canceling", "canceled"},
    "meshdeform run x.glb --set guidance_s": {"guidance_scale="},
    # A service that is not there offers no ids, and keeps nobody waiting.
    "meshdeform watch job_": set(),
}


def test_bash_offers_what_there_is() -> None:
    bash = shutil.which("bash")
    if bash is None or not PROGRAM.exists():
        pytest.skip("bash or the installed program is missing")
    script = f"source <({PROGRAM} --show-completion bash)\n"
    for line in OFFERED:
        words = line.split(" ")
        script += (
            f"COMP_WORDS=({' '.join(words[:-1])} '{words[-1]}'); COMP_CWORD={len(words) - 1}; COMPREPLY=()\n"
            "_meshdeform_completion meshdeform; echo ${COMPREPLY[@]}\n"
        )
    environment = {**os.environ, "PATH": f"{PROGRAM.parent}:{os.environ['PATH']}"}
    environment |= {"MESHDEFORM_URL": "http://127.0.0.1:1", "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = subprocess.run([bash, "-c", script], capture_output=True, text=True, check=True, env=environment)
    assert done.stderr == ""
    offered = [set(line.split()) for line in done.stdout.splitlines()]
    assert dict(zip(OFFERED, offered, strict=True)) == OFFERED
