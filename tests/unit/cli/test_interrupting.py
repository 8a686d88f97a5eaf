"""Ctrl-C in a call of compiled code that does not return, which Python's own handlers wait for."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import time

from meshdeform.cli.exits import ExitCode
from meshdeform.cli.local import ctrl_c_between_steps, second_ctrl_c_ends

IN_COMPILED_CODE = """
import hashlib, signal
from meshdeform.cli.local import second_ctrl_c_ends
signal.signal(signal.SIGINT, lambda *_: print("heard", flush=True))
with second_ctrl_c_ends():
    print("begins", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)
"""


def test_the_second_one_ends_the_process() -> None:
    with subprocess.Popen([sys.executable, "-c", IN_COMPILED_CODE], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begins\n"
        deadline = time.monotonic() + 60.0
        try:
            # Signals that come close together are one.
            while process.poll() is None and time.monotonic() < deadline:
                process.send_signal(signal.SIGINT)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(0.5)
            assert process.returncode == ExitCode.INTERRUPTED
        finally:
            process.kill()


def test_what_ends_by_itself_is_left_alone() -> None:
    """Both handlers are as before, one within the other too."""
    handler, descriptor = signal.getsignal(signal.SIGINT), signal.set_wakeup_fd(-1)
    with second_ctrl_c_ends():
        try:
            with ctrl_c_between_steps() as interrupted:
                assert not interrupted()
                signal.raise_signal(signal.SIGINT)
                assert interrupted()
                signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            interrupted = None
    assert interrupted is None
    assert signal.getsignal(signal.SIGINT) is handler
    assert signal.set_wakeup_fd(descriptor) == -1
