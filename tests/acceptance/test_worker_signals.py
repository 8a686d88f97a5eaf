"""Signals to the worker process at the worst moments, on a real Redis."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from meshdeform.record.models import JobState, NewJob, StoredFile
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from meshdeform.storage import ObjectStore
from tests.acceptance.cluster import until

pytestmark = pytest.mark.acceptance

ROOT = Path(__file__).resolve().parents[2]

STORM = """
    # At each bytecode of whatever handles the first signal comes another one, as when a supervisor with several threads
    # is killed and the kernel tells of each thread's death.
    import signal, sys

    def in_a_handler(frame, event, argument):
        frame.f_trace_opcodes = True
        if event == "opcode":
            signal.raise_signal(signal.SIGTERM)
        return in_a_handler

    def at_a_call(frame, event, argument):
        return in_a_handler if frame.f_code.co_name == "request_stop" or frame.f_back.f_trace is in_a_handler else None

    sys.settrace(at_a_call)
"""


def worker(folder: Path, redis_url: str, before: str, **environment: str) -> subprocess.Popen[bytes]:
    """The worker process without its supervisor, after a few lines of our own."""
    program = textwrap.dedent(before) + textwrap.dedent(
        """
        import sys
        from tests.fake_worker import engine
        from worker.process import main
        sys.exit(main(engine))
        """
    )
    settings = {"MESHDEFORM_DATA_DIR": str(folder), "MESHDEFORM_REDIS_URL": redis_url, "FAKE_STEP_S": "0.01"}
    return subprocess.Popen([sys.executable, "-c", program], env=os.environ | settings | environment, cwd=ROOT)


@pytest.fixture
def job_id(tmp_path: Path, redis_url: str) -> str:
    """A job that is queued."""
    stored = ObjectStore(str(tmp_path / "objects")).put("assets/a.obj", b"v 0 0 0", "model/obj")
    asset = StoredFile(key="assets/a.obj", filename="a.obj", size=stored.size, sha256=stored.sha256)
    record = JobRecord(f"sqlite:///{tmp_path / 'meshdeform.sqlite'}")
    job = record.create(
        NewJob(JobRequest.model_validate({"prompt": "a pear", "params": {"steps": 20}}), {"asset": asset})
    )
    record.close()
    queue = JobQueue(redis_url, "meshdeform")
    queue.enqueue(job.id)
    queue.close()
    return job.id


def test_a_burst_of_signals_in_the_midst_of_a_job_ends_the_worker_in_order(
    tmp_path: Path, redis_url: str, job_id: str
) -> None:
    gate = tmp_path / "gate"
    with worker(tmp_path, redis_url, STORM, MESHDEFORM_FAILPOINTS=f"worker.step=pause@3:{gate}") as process:
        try:
            until("the worker is there", Path(f"{gate}.reached").exists)
            process.send_signal(signal.SIGTERM)
            Path(f"{gate}.go").touch()
            assert process.wait(timeout=120.0) == 0
        finally:
            process.kill()
    record = JobRecord(f"sqlite:///{tmp_path / 'meshdeform.sqlite'}")
    assert record.get(job_id).state == JobState.QUEUED
    record.close()
