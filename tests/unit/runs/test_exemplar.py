"""Runs with `exemplar` guidance around a fit that is not theirs: steps, blending, controls, results, branches."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw

from meshdeform.assets import build_glb, load_asset
from meshdeform.errors import CheckpointError
from meshdeform.geometry.shapes import icosphere
from meshdeform.reading import NO_PART
from meshdeform.runs.exemplar_kind import STEPS
from meshdeform.vocabulary.solids import PART_NAMES
from tests.fake_exemplars import FACTORS, FakeFit, install
from tests.unit.runs.jobs import started

BALL = icosphere(2)
ASSET = build_glb(BALL.verts, BALL.faces)
GIRAFFE, SNAKE = np.array(FACTORS["giraffe"]), np.array(FACTORS["snake"])
TOP = {"box": {"min": [-2, 0, -2], "max": [2, 2, 2]}}
PROPOSED = {None: {"pumpkin": 0.6, "giraffe": 0.3}, "giraffe": {"giraffe": 1.0}}
KNOWN: dict[str, Any] = {"guidance": "exemplar", "source_noun": "pumpkin", "orientation": 0.0}


@pytest.fixture(autouse=True)
def _stretched(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    install(monkeypatch)
    yield
    FakeFit.made.clear()


def run_of(prompt: str = "a giraffe", **more: Any) -> Any:
    return started(ASSET, prompt, prior=None, **{**KNOWN, **more})


def finished(run: Any) -> dict[str, bytes]:
    for _ in run:
        pass
    return {name: artifact.data for name, artifact in run.finish().items()}


def places(glb: bytes) -> np.ndarray:
    return load_asset(glb, "a.glb").surface.positions


def moved(prompt: str = "a giraffe", **more: Any) -> np.ndarray:
    return places(finished(run_of(prompt, **more))["result.glb"])


def report(prompt: str = "a giraffe", **more: Any) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(finished(run_of(prompt, **more))["report.json"])
    return told


REST = places(ASSET)


def test_the_asset_goes_where_its_fit_does_in_steps_of_equal_time() -> None:
    run = run_of()
    steps = [(each.step, each.total_steps) for each in run]
    assert steps == [(number, STEPS) for number in range(1, STEPS + 1)]
    assert np.allclose(places(run.finish()["result.glb"].data), REST * GIRAFFE, atol=1e-6)


def test_the_shape_on_the_way_is_that_of_the_last_stage() -> None:
    run = run_of()
    shown = {each.step: places(run.snapshot().data) for each in run}
    assert np.array_equal(shown[1], REST)
    assert np.allclose(shown[int(0.7 * STEPS)], (REST + REST * GIRAFFE) / 2, atol=1e-6)
    assert np.allclose(shown[STEPS], REST * GIRAFFE, atol=1e-6)


def test_strength_and_seed_reach_the_fit() -> None:
    assert np.allclose(moved(strength=0.5), (REST + REST * GIRAFFE) / 2, atol=1e-6)
    assert np.array_equal(moved(strength=0.0), REST)
    assert not np.allclose(moved(seed=3), moved(), atol=1e-3)


def test_prompts_are_blended_by_their_weights() -> None:
    both = {"prompts": [{"prompt": "a snake", "weight": 0.5}]}
    run = run_of(**both)
    assert len(list(run)) == 2 * STEPS
    expected = REST + (2 * (REST * GIRAFFE - REST) + REST * SNAKE - REST) / 3
    assert np.allclose(places(run.finish()["result.glb"].data), expected, atol=1e-6)
    alone = {"prompts": [{"prompt": "a snake", "weight": 0.25}]}  # less than 1 in all: not divided
    assert np.allclose(moved("", **alone), REST + (REST * SNAKE - REST) / 4, atol=1e-6)


def test_a_prompt_moves_its_region() -> None:
    result = moved("", prompts=[{"prompt": "a giraffe", "regions": [TOP]}], falloff=0.0)
    below, above = REST[:, 1] < -0.2, REST[:, 1] > 0.2
    assert np.array_equal(result[below], REST[below])
    assert np.allclose(result[above], (REST * GIRAFFE)[above], atol=1e-6)


def test_what_is_kept_keeps_its_bits_and_the_rest_goes() -> None:
    files = finished(run_of(regions=[{**TOP, "action": "keep"}], falloff=0.2))
    result, told = places(files["result.glb"]), json.loads(files["report.json"])
    kept = (np.abs(result - REST) == 0).all(1)
    assert (REST[kept, 1] >= 0).all()
    assert kept.sum() == told["regions"]["kept_vertices"] > 50
    assert told["regions"]["max_moved"] == 0
    lowest = REST[:, 1].argmin()
    assert np.allclose(result[lowest], (REST * GIRAFFE)[lowest], atol=1e-6)


def test_handles_are_at_their_goals_and_soft_ones_go_their_share() -> None:
    top, side = REST[:, 1].argmax(), REST[:, 0].argmax()
    goals = {int(top): REST[top] * [1, 2, 1], int(side): REST[side] + [0, 0.2, 0]}
    handles = [{"vertex": vertex, "to": goal.tolist()} for vertex, goal in goals.items()]
    free = places(finished(run_of())["result.glb"])
    files = finished(run_of(handles=handles))
    result, told = places(files["result.glb"]), json.loads(files["report.json"])
    assert max(each["distance"] for each in told["handles"]) < 1e-6
    assert np.allclose(result[list(goals)], list(goals.values()), atol=1e-5)
    far = np.linalg.norm(free - free[top], axis=1) > 2.2
    assert np.allclose(result[far & (REST[:, 0] < 0)], free[far & (REST[:, 0] < 0)], atol=1e-3)
    soft = moved(handles=[{**handles[0], "weight": 0.25}])
    assert np.allclose(soft[top], free[top] + 0.25 * (goals[int(top)] - free[top]), atol=1e-5)


def test_a_handle_and_its_mirror_image_go_together() -> None:
    side, other = REST[:, 0].argmax(), REST[:, 0].argmin()
    goal = REST[side] + [0.3, 0.2, 0]
    files = finished(run_of(symmetry="x", handles=[{"vertex": int(side), "to": goal.tolist()}]))
    result, told = places(files["result.glb"]), json.loads(files["report.json"])
    assert np.allclose(result[side], goal, atol=1e-5)
    assert np.allclose(result[other], goal * [-1, 1, 1], atol=1e-5)
    assert told["symmetry"]["added_deviation"] < 1e-6


@pytest.mark.parametrize("mode", ["rigid", "similarity"])
def test_a_rigid_part_keeps_its_shape_and_its_surroundings_go_along(mode: str) -> None:
    lid = {"box": {"min": [-2, 0.7, -2], "max": [2, 2, 2]}, "mode": mode}
    files = finished(run_of(rigid=[lid], falloff=0.2))
    result, told = places(files["result.glb"]), json.loads(files["report.json"])
    assert told["rigid"]["bodies"] == 1
    assert told["rigid"]["max_deviation"] < 1e-6
    assert told["quality"]["flipped_faces"] == 0
    low = REST[:, 1] < 0
    assert np.allclose(result[low], (REST * GIRAFFE)[low], atol=1e-5)


def disc(wide: float, high: float) -> bytes:
    picture, file = Image.new("L", (128, 128)), io.BytesIO()
    ImageDraw.Draw(picture).ellipse((64 - wide, 64 - high, 64 + wide, 64 + high), fill=255)
    picture.save(file, "PNG")
    return file.getvalue()


def test_pictures_pull_at_the_outlines_of_a_fit() -> None:
    views = [{"azimuth": 0.0}, {"azimuth": 90.0}]
    files = finished(run_of(silhouettes=views, pictures=[disc(20, 50), disc(40, 50)]))
    result, told = places(files["result.glb"]), json.loads(files["report.json"])
    wide, high, deep = np.ptp(result, axis=0)
    assert wide / high == pytest.approx(0.4, abs=0.06)
    assert deep / high == pytest.approx(0.8, abs=0.08)
    assert min(each["iou"] for each in told["silhouettes"]) > 0.9
    assert told["quality"]["flipped_faces"] == 0
    assert told["guidance"]["sha256"]


def test_the_report_says_what_was_taken_and_what_became_of_it() -> None:
    told = report("a tall giraffe")
    (entry,) = told["exemplars"]
    assert entry["prompt"] == "a tall giraffe"
    assert entry["member"] == {"noun": "giraffe", "form": "standing", "number": 7}
    assert entry["pairs"] == [{"asset": "leg", "exemplar": "leg"}]
    assert (entry["left_over"], entry["missing"]) == (["tail"], ["horn"])
    assert (entry["distance_before"], entry["distance"], entry["kept"]) == (0.05, 0.01, 0.9)
    assert set(entry["seconds"]) == {"choose", "fit", "mend"}
    assert told["way"] == "exemplar"
    assert told["guidance"] == {"id": "exemplar", "revision": "", "sha256": ""}
    assert told["reading"]["noun"] == told["source_noun"]["noun"] == "pumpkin"
    assert told["params"]["guidance"] == "exemplar"
    assert told["likeness"]["noun"] == "giraffe"
    assert told["verdict"]["value"] in ("good", "doubtful", "keep_source")


def test_what_keeps_less_than_half_of_its_way_is_not_good(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = FakeFit.__iter__

    def hardly(self: FakeFit) -> Iterator[Any]:
        yield from whole(self)
        object.__setattr__(self.result, "kept", 0.3)

    monkeypatch.setattr(FakeFit, "__iter__", hardly)
    verdict = report()["verdict"]
    assert verdict["value"] != "good"
    assert any("only 30% of the way" in reason for reason in verdict["reasons"])


def test_a_morph_ends_at_the_result() -> None:
    files = finished(run_of(output={"morph": True}))
    assert set(files) == {"result.glb", "preview.png", "report.json", "morph.glb"}
    assert np.allclose(places(files["morph.glb"]), REST * GIRAFFE, atol=1e-6)


def test_the_same_request_gives_the_same_bytes_also_when_it_is_resumed() -> None:
    files = finished(run_of())
    run = run_of()
    steps = iter(run)
    for _ in range(STEPS * 4 // 5):
        next(steps)
    resumed = run_of(checkpoint=run.checkpoint())
    assert (resumed.step, resumed.first_step) == (0, 0)
    again = finished(resumed)
    assert {name: again[name] for name in ("result.glb", "preview.png")} == {
        name: files[name] for name in ("result.glb", "preview.png")
    }
    with pytest.raises(CheckpointError):
        run_of("a snake", checkpoint=run.checkpoint())


def test_a_branch_goes_on_from_the_shape_of_a_checkpoint() -> None:
    run = run_of()
    for _ in run:
        pass
    result = moved("a snake", initial=run.checkpoint())
    assert np.allclose(result, REST * GIRAFFE * SNAKE, atol=1e-5)


def test_a_branch_goes_on_from_an_optimised_shape() -> None:
    from tests.fakes import FakePrior

    other = started(ASSET, "an egg", prior=FakePrior(), steps=3)
    for _ in other:
        pass
    before = other.positions()
    middle = (before.min(0) + before.max(0)) / 2
    assert np.allclose(moved(initial=other.checkpoint()), middle + (before - middle) * GIRAFFE, atol=1e-5)


def test_a_correction_of_parts_reaches_the_fit() -> None:
    part = {"name": "horns", "box": TOP["box"]}
    finished(run_of(parts=[part, {"name": "wobble", "faces": [0]}]))
    labels = FakeFit.made[-1].labels
    assert labels is not None
    assert (labels == PART_NAMES.index("horn")).sum() > 50
    assert labels[0] == NO_PART  # no noun has such a part


@pytest.mark.parametrize(("share", "noun"), [(0.01, "giraffe"), (1e9, "pumpkin")])
def test_what_a_prompt_describes_is_believed_where_it_may_be(
    share: float, noun: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    proposed = "meshdeform.runs.reading._proposed"
    monkeypatch.setattr(proposed, lambda _points, _body, params: PROPOSED[params.source_noun])
    monkeypatch.setattr("meshdeform.runs.believed._AS_PROBABLE", share)
    told = report("a tall giraffe", source_noun=None)["reading"]
    assert told["noun"] == noun
    assert len(told["nouns"]) == 2
    assert report("a giraffe", source_noun=None)["reading"]["noun"] == "pumpkin"


def test_keep_is_the_front_of_the_file() -> None:
    finished(run_of(orientation="keep"))
    turned = FakeFit.made[-1].reading
    assert turned is not None
    assert np.allclose(turned.turn, np.eye(3))
    assert report(orientation=90.0)["reading"]["front_azimuth_deg"] == 90.0


def test_a_change_in_plain_words_stays_one() -> None:
    told = report("twice as tall")
    assert told["way"] == "change"
    assert not FakeFit.made


def test_a_target_is_placed_on_the_asset_and_measured() -> None:
    goal = build_glb(BALL.verts * [5.0, 4.0, 4.0] + 3.0, BALL.faces)
    files = finished(run_of("", target=goal, landmarks=[{"source": 0, "target": 0}]))
    told = json.loads(files["report.json"])
    wish = FakeFit.made[-1].wish
    assert wish.noun == ""
    assert np.abs(wish.targets[0].verts.mean(0)).max() < 0.01  # in the frame, not where its file has it
    assert wish.landmarks is not None
    source, end = wish.landmarks
    assert np.allclose(source[0], FakeFit.made[-1].frame.enter(REST[:1])[0])
    assert np.allclose(end[0], wish.targets[0].verts[0])
    assert told["exemplars"][0]["target"] == "target"
    assert {"to_target", "within", "landmarks"} <= set(told["fit"])
    assert told["guidance"]["sha256"]
