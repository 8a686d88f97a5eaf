"""Run a command and print what it used as JSON: ``python -I child.py COMMAND ...``.

Linux counts to the memory of a process what its parent held when it started it. So what runs a command to measure it
must be small, and this imports nothing.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys


def main() -> None:
    """Run the command of the arguments with its output thrown away, and print exit code, CPU seconds and memory."""
    process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    cpu = used.ru_utime + used.ru_stime
    print(json.dumps({"exit": process.returncode, "cpu_seconds": round(cpu, 2), "megabytes": used.ru_maxrss >> 10}))


if __name__ == "__main__":
    main()
