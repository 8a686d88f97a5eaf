"""The command that measures a GPU goes the same way on the CPU, so that it works where there is one."""

from __future__ import annotations

import pytest

from bench import gpu


@pytest.mark.long  # it runs what test_devices.py and test_stable_diffusion.py test
def test_the_command_for_a_gpu_goes_its_way_without_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["gpu", "--device", "cpu", "--small"])
    gpu.main()
    printed = capsys.readouterr().out
    assert "vertices 0.00e+00 apart" in printed
    assert "| a step of 5,120 faces |" in printed
