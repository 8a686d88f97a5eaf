"""What is printed: times, tables, progress lines, and nothing that commands a terminal."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import pytest
from typer.testing import CliRunner

from meshdeform import errors
from meshdeform.api.jobs import JobView
from meshdeform.cli import output
from meshdeform.cli.app import app
from meshdeform.cli.exits import ExitCode, exit_code, problem
from meshdeform.cli.jobs import left_running, outcome_failure
from meshdeform.cli.output import ago, duration, plain, table
from tests.cases import each_case


def test_what_is_printed_is_short_and_nothing_from_outside_commands_the_terminal() -> None:
    said = [duration(seconds) for seconds in (0.2, 59.4, 59.6, 125, 4800)]
    assert said == ["0 s", "59 s", "1 min 00 s", "2 min 05 s", "1 h 20 min"]
    assert [ago(s) for s in (-3, 12, 200, 7300, 200_000)] == ["0 s ago", "12 s ago", "3 min ago", "2 h ago", "2 d ago"]
    assert plain("a \x1b[31mred\x07 vase\u202e\n") == "a [31mred vase\n"
    assert table(("A", "B"), [("x\ny\x1b", "1"), ("long", "")]) == "A     B\nx y   1\nlong"
    clock = iter([0.0, 2.0, 22.0])
    pace = output.Pace(lambda: next(clock))
    assert [pace.eta_s(step, 11) for step in (1, 2, 12)] == [None, pytest.approx(18.0), pytest.approx(0.0)]


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
    assert lines[-1] == "step 1000/1000  loss 0.001"
    assert 4 <= len(lines) <= 6
    assert lines[1].endswith("15 s left")
    assert all(line.isprintable() for line in lines)
    with output.show_progress(quiet=True) as view:
        view.phase("loading")
        view.step(1, 1, 0.5)
    assert capsys.readouterr().err == ""


# What a job's end, an error or wrong usage is to a script: an exit code and, with --json, a problem document.


def job(state: str, error: dict[str, Any] | None = None) -> JobView:
    file = {"filename": "a.glb", "size": 1, "sha256": "0" * 64}
    empty: dict[str, Any] = {name: {} for name in ("params", "output", "metadata", "progress")}
    about = {"id": "job_x", "kind": "text_deform", "state": state, "prompt": "a vase", "asset": file, "error": error}
    return JobView.model_validate({**about, **empty, "created_at": datetime.now(UTC)})


def test_how_a_job_ended_is_an_exit_code_and_a_problem_document() -> None:
    assert outcome_failure(job("succeeded")) is None
    why = {"code": "gpu_oom", "title": "t", "detail": "No memory.", "advice": "Simplify the mesh.", "status": 500}
    for state, error, code in (("failed", why, 5), ("failed", None, 5), ("canceled", None, 6), ("expired", None, 6)):
        failure = outcome_failure(job(state, error))
        assert failure is not None
        document = problem(failure)
        assert (document["exit_code"], document["job_id"]) == (code, "job_x")
        if error:
            assert (document["code"], document["advice"]) == ("gpu_oom", "Simplify the mesh.")
            assert document["detail"] == "The job job_x failed: No memory."


@each_case(
    ("code", "kinds"),
    [
        (9, [errors.UnauthorizedError, errors.ForbiddenError]),
        (10, [errors.LimitError, errors.TooManyJobsError]),
        (4, [errors.RequestTimeoutError, errors.ModelError, errors.DependencyError, errors.UnavailableError]),
        (3, [errors.NotFoundError, errors.ConflictError, errors.AssetTruncatedError, errors.CheckpointError]),
        (1, [errors.NumericalError]),
    ],
)
def test_exit_codes(code: int, kinds: list[type[errors.MeshdeformError]]) -> None:
    assert {exit_code(kind("x")) for kind in kinds} == {code}


def test_a_problem_is_the_services_problem_with_the_exit_code() -> None:
    document = problem(errors.VocabularyError("No qwertz.", advice="Say vase.", unknown=["qwertz"]))
    assert document.pop("title")
    assert document == {
        "unknown": ["qwertz"],
        "type": "urn:meshdeform:problem:prompt_unknown_words",
        "status": 422,
        "code": "prompt_unknown_words",
        "detail": "No qwertz.",
        "advice": "Say vase.",
        "exit_code": 3,
    }


def test_ctrl_c_names_the_command_to_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHDEFORM_URL", "http://set:1")
    assert "meshdeform watch job_x\n" in left_running(["job_x"], "http://set:1").advice
    assert "wait job_x job_y --url http://other:1" in left_running(["job_x", "job_y"], "http://other:1").advice


@each_case(
    "arguments",
    [
        ["jobs", "--json", "--no-such"],
        ["watch", "--json"],
        ["jobs", "--json", "--url", "http://host:99999"],
        ["run", "nowhere.glb", "--json"],
        ["no-such-command", "--json"],
    ],
)
def test_wrong_usage_is_a_problem_document_too(arguments: list[str]) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == ExitCode.USAGE
    assert result.stdout == ""
    document = json.loads(result.stderr)
    assert (document["code"], document["exit_code"]) == ("usage", 2)


def test_a_service_that_is_not_there_is_exit_code_4(monkeypatch: pytest.MonkeyPatch) -> None:
    from meshdeform.client import Client
    from tests.servers import free_port

    monkeypatch.setattr(
        "meshdeform.cli.options.connect",
        lambda *_, **__: Client(f"http://127.0.0.1:{free_port()}", max_retries=0),
    )
    result = CliRunner().invoke(app, ["jobs", "--json"])
    assert result.exit_code == ExitCode.UNAVAILABLE
    assert json.loads(result.stderr.splitlines()[-1])["code"] == "unavailable"
