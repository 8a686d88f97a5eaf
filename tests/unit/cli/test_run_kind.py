"""`meshdeform run --kind`: what other kinds of job take, refused before a service is asked."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from meshdeform.cli.app import app
from tests.cases import each_case


@each_case(
    ("arguments", "said"),
    [
        (["a mushroom", "--kind", "surface_fit"], "has no prompt"),
        (["--kind", "surface_fit", "--compact"], "--compact"),
        (["--kind", "surface_fit", "--preset", "preview"], "preset"),
        (["--kind", "surface_fit", "--set", "base_faces=1"], "base_faces"),
        (["--kind", "surface_fit", "--file", "target=ball.obj"], "reads base"),
        (["--kind", "family_synthesize"], "collection=FILE"),
        (["--kind", "family_synthesize", "--file", "collection=nowhere.zip"], "not a file"),
        (["--kind", "unfold"], "surface_fit"),
        (["a mushroom", "--checkpoint", "state"], "--checkpoint"),
    ],
)
def test_what_does_not_go_together_is_refused_by_name(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("ball.obj").write_text("v 0 0 0\n")
    monkeypatch.setattr("meshdeform.cli.options.connect", lambda *_: pytest.fail("the service was asked"))
    result = CliRunner().invoke(app, ["run", "ball.obj", *arguments, "--url", "http://127.0.0.1:1"], terminal_width=200)
    assert result.exit_code in (2, 3)
    assert said in result.output


@each_case(
    ("arguments", "said"),
    [
        (["run", "ball.obj", "--kind", "surface_fit"], "meshdeform surface-fit"),
        (["run", "ball.obj", "a mushroom", "--detach"], "--url"),
        (["submit", "ball.obj", "a mushroom", "--wait"], "meshdeform run --url"),
    ],
)
def test_a_job_of_a_service_needs_its_address(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("ball.obj").write_text("v 0 0 0\n")
    result = CliRunner().invoke(app, arguments, terminal_width=200)
    assert result.exit_code in (2, 3)
    assert said in result.output
