"""The whole command on a few kilobytes of 2,000 boxes in one place, which used to take minutes and gigabytes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets import Primitive, build_glb
from training.shapes import box

pytestmark = pytest.mark.acceptance

COUNT, CPU_S, MEMORY_KIB = 2000, 30, 1 << 20


@pytest.mark.long  # test_crowded.py has each search
@pytest.mark.parametrize("apart", [0.0, 0.05])
def test_boxes_in_one_place_are_done_in_bounded_time_and_memory(tmp_path: Path, apart: float) -> None:
    one, offsets = box(1), np.random.default_rng(0).normal(0, apart, (COUNT, 3))
    source = tmp_path / "boxes.glb"
    source.write_bytes(build_glb([Primitive(one.verts.numpy() + by, one.faces.numpy()) for by in offsets]))
    command = [sys.executable, "-m", "meshdeform", "run", str(source), "a vase", "--preset", "preview", "--steps", "1"]
    process = subprocess.Popen([*command, "-o", str(tmp_path / "result.glb")], cwd=tmp_path)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    assert used.ru_utime + used.ru_stime < CPU_S
    assert used.ru_maxrss < MEMORY_KIB
