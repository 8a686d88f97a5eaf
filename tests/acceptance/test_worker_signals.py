"""Signals to the worker process at the worst moments, on a real Redis."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from meshdeform.record.models import JobState
from tests.acceptance.cluster import Cluster
from tests.acceptance.service import until

pytestmark = pytest.mark.acceptance

STORM = """
# At each bytecode of whatever handles the first signal comes another one, as when a supervisor with several threads
# is killed and the kernel tells of each thread's death.
import signal, sys
from tests.fake_worker import engine
from worker.process import main

def in_a_handler(frame, event, argument):
    frame.f_trace_opcodes = True
    if event == "opcode":
        signal.raise_signal(signal.SIGTERM)
    return in_a_handler

def at_a_call(frame, event, argument):
    return in_a_handler if frame.f_code.co_name == "request_stop" or frame.f_back.f_trace is in_a_handler else None

sys.settrace(at_a_call)
sys.exit(main(engine))
"""


def test_a_burst_of_signals_in_the_midst_of_a_job_ends_the_worker_in_order(cluster: Cluster) -> None:
    gate, job_id = cluster.folder / "gate", cluster.submit(20)
    worker = cluster._start(
        "worker", [sys.executable, "-c", STORM], {"MESHDEFORM_FAILPOINTS": f"worker.step=pause@3:{gate}"}
    )
    until("the worker is there", Path(f"{gate}.reached").exists)
    worker.send(signal.SIGTERM)
    Path(f"{gate}.go").touch()
    assert worker.process.wait(timeout=120.0) == 0
    assert cluster.job(job_id).state == JobState.QUEUED
