"""The command line as users have it: a process with pipes or a terminal, real signals, real exit codes."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from meshdeform.cli.app import app
from tests.acceptance.service import smaller

DEADLINE_S = 240.0


def command(*arguments: object) -> list[str]:
    """The command line of `meshdeform ARGUMENTS`."""
    return [sys.executable, "-P", "-m", "meshdeform", *(str(argument) for argument in arguments)]


def environment(**more: str) -> dict[str, str]:
    """The environment for it: one thread, small pictures, and a terminal that knows what terminals know."""
    return {**os.environ, **smaller(), "MESHDEFORM_THREADS": "1", "TERM": "xterm", "COLUMNS": "100", **more}


def run(*arguments: object, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """Run it to its end, with pipes."""
    return subprocess.run(
        command(*arguments),
        cwd=cwd,
        env=environment(**more),
        capture_output=True,
        text=True,
        check=False,
        timeout=DEADLINE_S,
    )


def call(*arguments: object, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """Run it in this process, which has loaded already what it needs, where no signal and no terminal is wanted."""
    with contextlib.chdir(cwd):
        result = CliRunner().invoke(app, [str(argument) for argument in arguments], env={"COLUMNS": "100", **more})
    return subprocess.CompletedProcess(arguments, result.exit_code, result.stdout, result.stderr)


def answer(*arguments: object, cwd: Path, **more: str) -> Any:
    """Call it with --json; its one document."""
    done = call(*arguments, "--json", cwd=cwd, **more)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    return json.loads(line)


@contextmanager
def started(*arguments: object, cwd: Path, **more: str) -> Iterator[subprocess.Popen[str]]:
    """A process for the block, killed at its end if it still runs, or if it takes too long."""
    with subprocess.Popen(
        command(*arguments),
        cwd=cwd,
        env=environment(**more),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        give_up = threading.Timer(DEADLINE_S, process.kill)
        give_up.start()
        try:
            yield process
        finally:
            give_up.cancel()
            process.kill()


def on_a_terminal(*arguments: object, cwd: Path, **more: str) -> tuple[int, str]:
    """Run it with a terminal for everything; its exit code and all that the terminal was sent."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        command(*arguments), cwd=cwd, env=environment(**more), stdin=theirs, stdout=theirs, stderr=theirs
    )
    os.close(theirs)
    give_up = threading.Timer(DEADLINE_S, process.kill)
    give_up.start()
    seen = b""
    try:
        while select.select([ours], [], [], DEADLINE_S)[0]:
            try:
                part = os.read(ours, 65536)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            seen += part
    finally:
        give_up.cancel()
        os.close(ours)
    return process.wait(timeout=DEADLINE_S), seen.decode(errors="replace")
