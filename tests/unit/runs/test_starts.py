"""Runs of a model that start from the exemplar's fit: the first shape, resuming, branches, controls and the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.torch
from numpy.typing import NDArray

from meshdeform.assets import build_glb, load_asset
from meshdeform.deformation.orientation import Orientation, OrientationSource
from meshdeform.errors import MeshdeformError, ParameterError, VocabularyError
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import check_request, kind_of
from meshdeform.runs.starts import Start
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.fake_exemplars import FACTORS, FakeFit, install
from tests.fakes import build_tiny_stable_diffusion
from tests.unit.runs.jobs import finished, started

BALL = icosphere(2)
ASSET = build_glb(BALL.verts * 3.0 + [5.0, 7.0, 0.0], BALL.faces)
REST = load_asset(ASSET, "a.glb").surface.positions
MIDDLE = np.array([5.0, 7.0, 0.0])
FITTED = (REST - MIDDLE) * FACTORS["giraffe"] + MIDDLE
KNOWN: dict[str, Any] = {"start": "exemplar", "steps": 4, "source_noun": "pumpkin", "orientation": 0.0}


@pytest.fixture(autouse=True)
def _stretched(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    install(monkeypatch)
    yield
    FakeFit.made.clear()


def run_of(prompt: str = "a giraffe", **more: Any) -> Any:
    return started(ASSET, prompt, **{**KNOWN, **more})


def after(run: Any, steps: int) -> Any:
    """Return the run after so many steps."""
    for each in run:
        if each.step == steps:
            break
    return run


def places(glb: bytes) -> NDArray[np.float64]:
    return load_asset(glb, "a.glb").surface.positions


def test_the_first_shape_is_the_fit_and_the_asset_remains_what_results_are_compared_with() -> None:
    run = run_of()
    assert run.step == 0
    assert np.allclose(run.positions(), FITTED, atol=1e-6)
    assert np.array_equal(places(run.snapshot().data), run.positions().astype(np.float32))
    result, told = finished(run)
    assert len(FakeFit.made) == 1
    moved = np.linalg.norm(places(result) - REST, axis=1)
    assert told["movement"]["rms"] == pytest.approx(
        np.sqrt((moved**2).mean()) / np.linalg.norm(np.ptp(REST, 0)), rel=0.1
    )
    assert not np.allclose(places(result), FITTED, atol=1e-3)  # the model went on


def test_by_default_a_model_starts_from_the_asset() -> None:
    run = run_of(start="asset")
    assert np.allclose(run.positions(), REST)
    assert not any(name.startswith("start") for name in safetensors.torch.load(run.checkpoint()))
    assert finished(run)[1]["start"] is None
    assert not FakeFit.made


def test_the_report_says_to_what_the_asset_was_fitted() -> None:
    (entry,) = finished(run_of())[1]["start"]
    assert entry["prompt"] == "a giraffe"
    assert entry["member"]["noun"] == "giraffe"
    assert (entry["distance_before"], entry["distance"], entry["kept"]) == (0.05, 0.01, 0.9)


def test_several_prompts_start_from_their_blended_fits() -> None:
    run = run_of(prompts=[{"prompt": "a snake", "weight": 0.5}])
    snake = (REST - MIDDLE) * FACTORS["snake"] + MIDDLE
    assert np.allclose(run.positions(), REST + (2 * (FITTED - REST) + snake - REST) / 3, atol=1e-6)
    assert [each["prompt"] for each in finished(run)[1]["start"]] == ["a giraffe", "a snake"]


def same_state(one: bytes, other: bytes) -> None:
    first, second = safetensors.torch.load(one), safetensors.torch.load(other)
    assert first.keys() == second.keys()
    assert all(np.array_equal(tensor.numpy(), second[name].numpy()) for name, tensor in first.items())


def builtin(_folder: Path) -> Any:
    return load_prior("builtin", device="cpu")


def stable_diffusion(folder: Path) -> Any:
    return StableDiffusionPrior(str(build_tiny_stable_diffusion(folder)))


@pytest.mark.parametrize(
    ("load", "model"), [(builtin, "builtin"), (stable_diffusion, "tiny/one")], ids=["builtin", "stable diffusion"]
)
def test_a_run_that_resumes_fits_nothing_again_and_ends_with_the_same_bytes(
    load: Callable[[Path], Any], model: str, tmp_path: Path
) -> None:
    given = {"prior": load(tmp_path), "model": model}
    whole = run_of(**given)
    state = after(whole, 2).checkpoint()
    expected, told = finished(whole)
    made = len(FakeFit.made)
    resumed = run_of(**given, checkpoint=state)
    same_state(resumed.checkpoint(), state)
    again, said = finished(resumed)
    assert len(FakeFit.made) == made
    assert again == expected
    same_state(resumed.checkpoint(), whole.checkpoint())
    assert said["start"] == told["start"]
    assert said["orientation"] == told["orientation"]


def test_a_front_that_is_to_be_found_is_that_of_the_fit() -> None:
    told = finished(run_of(orientation="auto"))[1]["orientation"]
    reading = FakeFit.made[0].reading
    assert reading is not None
    assert told["source"] in {"found", "undecided"}
    angle = np.radians(told["turn_deg"])
    assert np.allclose(reading.turn @ [np.sin(angle), 0.0, np.cos(angle)], [0.0, 0.0, 1.0])
    asset = Orientation(135.0, OrientationSource.FOUND)
    assert Start(BALL, [], turn_deg=90.0).turned(asset) == Orientation(-135.0, OrientationSource.FOUND)
    assert Start(BALL).turned(asset) == asset


def test_a_model_that_leaves_the_cameras_where_they_are_starts_from_a_fit_by_the_front_that_was_read() -> None:
    kept = run_of(preset="paper", orientation="keep", carrier="surface")
    assert kept.orientation.turn_deg == 0.0
    assert FakeFit.made[-1].reading is None or np.allclose(FakeFit.made[-1].reading.turn, np.eye(3))
    left = {name: value for name, value in KNOWN.items() if name != "orientation"}
    started(ASSET, "a giraffe", preset="paper", **left)
    assert len(FakeFit.made) == 2


def test_what_is_kept_has_the_bits_of_the_asset() -> None:
    top = {"box": {"min": [-9, 8, -9], "max": [9, 99, 9]}, "action": "keep"}
    run = run_of(regions=[top], falloff=0.2)
    kept = run._facts.control.constraints.kept[run._facts.welded.vertex_map]
    assert 20 < kept.sum() < len(REST) - 20
    lowest = REST[:, 1].argmin()
    assert np.allclose(run.positions()[lowest], FITTED[lowest], atol=1e-6)
    result, told = finished(run)
    assert np.array_equal(places(result)[kept], REST[kept])
    assert told["regions"]["max_moved"] == 0


def test_handles_are_at_their_goals() -> None:
    side = int(REST[:, 0].argmax())
    goal = REST[side] + [1.0, 0.5, 0.0]
    _, told = finished(run_of(handles=[{"vertex": side, "to": goal.tolist()}]))
    (handle,) = told["handles"]
    assert handle["distance"] < 1e-6
    assert np.allclose(handle["reached"], goal, atol=1e-5)


def test_a_rigid_part_keeps_the_shape_that_it_has_in_the_file() -> None:
    lid = {"box": {"min": [-9, 9, -9], "max": [9, 99, 9]}, "mode": "rigid"}
    _, told = finished(run_of(rigid=[lid]))
    assert told["rigid"]["max_deviation"] < 1e-6


def test_a_mirror_symmetry_is_kept() -> None:
    _, told = finished(run_of(symmetry="x"))
    assert told["symmetry"]["added_deviation"] < 1e-6


def test_a_branch_goes_on_from_the_fit_of_its_job_whatever_guides_it() -> None:
    first = after(run_of(), 2)
    state = first.checkpoint()
    goal = build_glb(BALL.verts * [2.0, 4.0, 2.0], BALL.faces)
    plain = {name: value for name, value in KNOWN.items() if name != "start"}
    branches = [
        run_of("a snake", initial=state),
        run_of("a snake", initial=state, start="asset", seed=5),
        started(ASSET, "", initial=state, guidance="target", target=goal, steps=4),
    ]
    assert len(FakeFit.made) == 1
    for branch in branches:
        assert np.allclose(branch.positions(), first.positions(), atol=1e-9)
    middle = after(branches[1], 2)  # the branch of a branch goes on from it as well
    assert np.allclose(run_of(initial=middle.checkpoint()).positions(), middle.positions(), atol=1e-9)
    del plain["steps"]
    fitted = started(ASSET, "a snake", prior=None, guidance="exemplar", initial=state, **plain)
    assert np.allclose(places(fitted.snapshot().data), first.positions(), atol=1e-5)
    assert np.allclose(places(finished(branches[2])[0])[0], branches[2].positions()[0], atol=1e-5)


def test_a_branch_of_a_job_that_started_from_the_asset_does_so_too() -> None:
    first = after(run_of(start="asset"), 2)
    branch = run_of(initial=first.checkpoint())
    assert np.allclose(branch.positions(), first.positions(), atol=1e-9)
    assert not FakeFit.made


def request(prompt: str = "a giraffe", **params: Any) -> JobRequest:
    return JobRequest.model_validate(
        {"prompt": prompt, "params": grouped({"guidance": "sds", "start": "exemplar"} | params)}
    )


GUIDANCE = ["params", "guidance"]


@each_case(
    ("asked", "files", "error", "words", "place"),
    [
        (request("a robot of gold"), (), ParameterError, "leave .gold. out", [*GUIDANCE, "start"]),
        (request(prompts=[{"prompt": "a golden robot"}]), (), ParameterError, "robot", [*GUIDANCE, "start"]),
        (request(source_noun="zeitgeist"), (), VocabularyError, "zeitgeist", [*GUIDANCE, "source_noun"]),
        (
            request(silhouettes=[{"azimuth": 0.0}]),
            ("silhouette_1",),
            ParameterError,
            "takes no pictures",
            [*GUIDANCE, "start"],
        ),
    ],
)
def test_what_has_no_exemplar_is_refused(
    tmp_path: Path,
    asked: JobRequest,
    files: tuple[str, ...],
    error: type[MeshdeformError],
    words: str,
    place: list[Any],
) -> None:
    with pytest.raises(error, match=words) as caught:
        check_request(asked, Settings(model=str(build_tiny_stable_diffusion(tmp_path))), files=["asset", *files])
    assert [each["loc"] for each in caught.value.extra["errors"]] == [place]


def test_what_has_one_passes_for_any_model(tmp_path: Path) -> None:
    for model in ("builtin", str(build_tiny_stable_diffusion(tmp_path))):
        for asked in (request(), request("", prompts=[{"prompt": "a cat"}]), request("longer legs")):
            check_request(asked, Settings(model=model), files=["asset"])
    check_request(request("a robot of gold", start="asset"), Settings(model=str(tmp_path)), files=["asset"])


def test_a_branch_asks_for_no_start_that_its_job_does_not_have() -> None:
    as_branch = kind_of(request().kind).as_branch
    assert as_branch(request(), request("a cat")).prompt == "a cat"
    assert as_branch(request(), request("a robot of gold", start="asset")).prompt == "a robot of gold"
    with pytest.raises(ParameterError, match="has not started from an exemplar"):
        as_branch(request(start="asset"), request())
