"""What is printed: times, tables, progress lines, and nothing that commands a terminal."""

from __future__ import annotations

import pytest

from meshdeform.cli import output
from meshdeform.cli.output import ago, duration, plain, table
from tests.cases import each_case


@each_case(
    ("seconds", "said"), [(0.2, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (125, "2 min 05 s"), (4800, "1 h 20 min")]
)
def test_durations(seconds: float, said: str) -> None:
    assert duration(seconds) == said


def test_ages() -> None:
    assert [ago(s) for s in (-3, 12, 200, 7300, 200_000)] == ["0 s ago", "12 s ago", "3 min ago", "2 h ago", "2 d ago"]


def test_nothing_from_outside_commands_the_terminal() -> None:
    assert plain("a \x1b[31mred\x07 vase\u202e\n") == "a [31mred vase\n"
    assert table(("A", "B"), [("x\ny\x1b", "1"), ("long", "")]) == "A     B\nx y   1\nlong"


def test_time_left_by_the_pace() -> None:
    now = [0.0]
    pace = output.Pace(lambda: now[0])
    assert pace.eta_s(1, 11) is None
    now[0] = 2.0
    assert pace.eta_s(2, 11) == pytest.approx(18.0)
    now[0] = 22.0
    assert pace.eta_s(12, 11) == pytest.approx(0.0)


def test_lines_are_bounded_and_have_no_control_characters(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    with output.show_progress() as view:
        view.phase("loading")
        view.phase("loading")
        for step in range(1, 1001):
            now[0] += 0.02  # 20 s in all
            view.step(step, 1000, 1.0 / step, eta_s=(1000 - step) * 0.02)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "loading"
    assert lines[-1] == "step 1000/1000  loss 0.0010"
    assert 4 <= len(lines) <= 6
    assert lines[1].endswith("15 s left")
    assert all(line.isprintable() for line in lines)


def test_quiet_is_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    with output.show_progress(quiet=True) as view:
        view.phase("loading")
        view.step(1, 1, 0.5)
    assert capsys.readouterr().err == ""
