"""The job behind `meshdeform run`."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from meshdeform.cli.app import app
from meshdeform.cli.local import LocalJob, ctrl_c_between_steps
from meshdeform.cli.output import show_progress
from meshdeform.errors import ModelError
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.fakes import FakePrior
from tests.unit.assets.test_archive import image, scene
from tests.unit.assets.test_replace import DOT


def test_the_prior_is_loaded_as_the_settings_say(tmp_path: Path) -> None:
    seen: list[Any] = []

    def load(model: str, **how: Any) -> Any:
        seen.append((model, how))
        raise ModelError("Enough was seen.")

    asset = tmp_path / "a.glb"
    asset.write_bytes(b"is not read before the prior is there")
    settings = Settings(model="some/model", model_revision="v2", dtype="bfloat16", device="cpu")
    with pytest.raises(ModelError, match="Enough"), show_progress(quiet=True) as silent:
        LocalJob(JobRequest(prompt="a vase"), {"asset": asset}, {}, settings, load=load).run(silent)
    assert seen == [("some/model", {"device": "cpu", "revision": "v2", "dtype": "bfloat16"})]


@each_case(
    ("options", "kind"),
    [
        (["a giraffe"], "exemplar"),
        (["a giraffe", "--strength", "0.5"], "exemplar"),
        (["a giraffe", "--guidance", "sds"], "sds"),
        (["a giraffe", "--preset", "preview"], "sds"),
        (["a giraffe", "--steps", "3"], "sds"),
        (["a giraffe", "--model", "builtin"], "sds"),
        (["a giraffe", "--set", "laplacian_weight=0.3"], "sds"),
        (["--target", "a.glb", "--set", "laplacian_weight=0.3"], "target"),
        (["--target", "a.glb", "--target", "a.glb"], "exemplar"),
    ],
)
def test_options_decide_what_guides_a_run_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], kind: str
) -> None:
    class Seen(Exception):
        pass

    asked: list[str] = []

    def run(job: LocalJob, **_: Any) -> None:
        asked.append(job.request.params.kind.value)
        raise Seen

    monkeypatch.setattr(LocalJob, "check", run)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.glb").write_bytes(b"")
    CliRunner().invoke(app, ["run", "a.glb", *options])
    assert asked == [kind]


def test_the_files_beside_a_gltf_come_along(tmp_path: Path) -> None:
    for name, data in scene().items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    outputs = {name: tmp_path / name for name in ("result.glb", "report.json", "preview.png")}
    request = JobRequest.model_validate({"prompt": "an egg", "params": {"preset": "preview", "steps": 1}})
    files = {"asset": tmp_path / "model/scene.gltf"}
    job = LocalJob(request, files, outputs, Settings(device="cpu"), load=lambda *_, **__: FakePrior())
    with show_progress(quiet=True) as silent:
        finished = job.run(silent)
    assert image(outputs["result.glb"].read_bytes()) == image(finished.artifacts["result.glb"]) == DOT


@each_case(
    ("line", "said"),
    [
        ("mushroom --kind surface_fit --url", "has no prompt"),
        ("--kind surface_fit --compact --url", "--compact"),
        ("--kind surface_fit --preset preview --url", "preset"),
        ("--kind surface_fit --set base_faces=1 --url", "base_faces"),
        ("--kind surface_fit --file target=ball.obj --url", "reads base"),
        ("--kind family_synthesize --url", "collection=FILE"),
        ("--kind family_synthesize --file collection=nowhere.zip --url", "not a file"),
        ("--kind unfold --url", "surface_fit"),
        ("mushroom --checkpoint state --url", "--checkpoint"),
        ("mushroom --detach", "--url"),
    ],
)
def test_what_does_not_go_together_is_refused_before_a_service_is_asked(
    line: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("ball.obj").write_text("v 0 0 0\n")
    monkeypatch.setattr("meshdeform.cli.options.connect", lambda *_: pytest.fail("the service was asked"))
    arguments = line.replace("--url", "--url http://127.0.0.1:1") if line.endswith("--url") else line
    result = CliRunner().invoke(app, ["run", "ball.obj", *arguments.split()], terminal_width=200)
    assert result.exit_code in (2, 3)
    assert said in result.output


def test_the_first_ctrl_c_waits_for_the_step_and_the_second_does_not() -> None:
    handler = signal.getsignal(signal.SIGINT)
    with ctrl_c_between_steps() as interrupted:
        assert not interrupted()
        signal.raise_signal(signal.SIGINT)
        assert interrupted()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is handler
