"""Shell completion, by really asking bash."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cases import each_case

PROGRAM = Path(sys.executable).with_name("meshdeform")


@pytest.fixture(scope="module")
def bash() -> str:
    """A bash, with the installed program beside this interpreter."""
    found = shutil.which("bash")
    if found is None or not PROGRAM.exists():
        pytest.skip("bash or the installed program is missing")
    return found


OFFERED = {
    "meshdeform ba": {"batch"},
    "meshdeform run x.glb --preset ": {"preview", "balanced", "paper"},
    "meshdeform run x.glb --model b": {"builtin"},
    "meshdeform jobs --state ca": {"canceling", "canceled"},
    "meshdeform run x.glb --set guidance_s": {"guidance_scale="},
    # A service that is not there offers no ids, and keeps nobody waiting.
    "meshdeform watch job_": set(),
}


@pytest.fixture(scope="module")
def offered(bash: str) -> dict[str, set[str]]:
    """What one bash offers after each of the lines."""
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
    found = done.stdout.splitlines()
    assert len(found) == len(OFFERED)
    return {line: set(each.split()) for line, each in zip(OFFERED, found, strict=True)}


@each_case("line", OFFERED)
def test_bash_offers_what_there_is(offered: dict[str, set[str]], line: str) -> None:
    assert offered[line] == OFFERED[line]


@each_case("shell", ["bash", "zsh", "fish"])
def test_every_shell_has_a_script(shell: str) -> None:
    environment = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    command = [
        sys.executable,
        "-P",
        "-c",
        "import sys; sys.argv[0] = 'meshdeform'; from meshdeform.cli.app import main; main()",
    ]
    done = subprocess.run(
        [*command, "--show-completion", shell], capture_output=True, text=True, check=True, env=environment
    )
    assert "_MESHDEFORM_COMPLETE" in done.stdout
