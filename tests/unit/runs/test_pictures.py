"""Jobs with pictures as targets: what belongs together, what the report says; and jobs whose rig follows."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from PIL import Image
from pydantic import ValidationError

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.report_lines import silhouettes_line
from meshdeform.cli.request import parse_pictures
from meshdeform.errors import ParameterError, PromptError, SilhouetteError
from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import check_request
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.unit.assets.playing import Player
from tests.unit.assets.test_rig import arm
from tests.unit.runs.jobs import finished, started

SPHERE = icosphere(2)
GLB = build_glb(SPHERE.verts, SPHERE.faces)
BOTH = [{"azimuth": 0}, {"azimuth": 90}]
ALONE: dict[str, Any] = {"guidance": "silhouettes", "prior": None}


def ellipse(height: float, width: float) -> bytes:
    rows, columns = np.mgrid[:120, :160] + 0.5
    mask = ((rows - 50) / height) ** 2 + ((columns - 90) / width) ** 2 < 1
    buffer = io.BytesIO()
    Image.fromarray(np.where(mask, 0, 255).astype(np.uint8)).save(buffer, "PNG")
    return buffer.getvalue()


def request(prompt: str = "", **params: object) -> JobRequest:
    return JobRequest.model_validate({"prompt": prompt, "params": grouped(params)})


def refused(asked: JobRequest, *pictures: str, target: bool = False) -> ParameterError:
    with pytest.raises(ParameterError) as caught:
        check_request(asked, Settings(), files=["asset", *(["target"] if target else []), *pictures])
    return caught.value


def test_pictures_and_their_directions_belong_together() -> None:
    alone = request(guidance="silhouettes", silhouettes=BOTH)
    resolved: Any = check_request(alone, Settings(), files=["asset", "silhouette_1", "silhouette_2"])
    assert resolved.silhouettes[1].azimuth == 90
    assert "`silhouette_2` is missing" in refused(alone, "silhouette_1").detail
    assert "`silhouette_3` was sent" in refused(alone, "silhouette_1", "silhouette_2", "silhouette_3").detail
    assert "at least one picture" in refused(request(guidance="silhouettes")).detail
    assert "There is a prompt" in refused(request("a vase", guidance="silhouettes", silhouettes=BOTH[:1])).detail
    twice = request(guidance="silhouettes", silhouettes=[{"azimuth": 350}, {"azimuth": -10.2}])
    assert "same azimuth" in refused(twice, "silhouette_1", "silhouette_2").detail
    with pytest.raises(ValidationError, match=r"guidance\.target\.silhouettes"):
        request(guidance="target", silhouettes=BOTH[:1])
    beside = request(guidance="target")
    assert "second mesh" in refused(beside, "silhouette_1", target=True).detail
    assert refused(beside, "silhouette_1", target=True).extra["errors"][0]["loc"] == ["params", "guidance"]
    with pytest.raises(PromptError):
        check_request(request(silhouettes=BOTH[:1]), Settings(), files=["asset", "silhouette_1"])
    assert check_request(request("a vase", silhouettes=BOTH[:1]), Settings(), files=["asset", "silhouette_1"])


def test_the_report_has_the_overlap_of_every_view_before_and_after() -> None:
    run = started(GLB, "", **ALONE, silhouettes=BOTH, steps=25, pictures=[ellipse(40, 20), ellipse(20, 15)])
    result, report = finished(run)
    first, second = report["silhouettes"]
    assert (first["part"], first["azimuth"], second["azimuth"]) == ("silhouette_1", 0, 90)
    assert first["iou_before"] < 0.75 < 0.9 < first["iou"]
    assert report["guidance"]["id"] == "silhouettes"
    size = np.ptp(load_asset(result).surface.positions, axis=0)
    # The front is twice as high as wide; the side, of another scale, four thirds as high as wide.
    np.testing.assert_allclose([size[1] / size[0], size[1] / size[2]], [2, 4 / 3], rtol=0.12)
    assert "0 degrees" in silhouettes_line(report["silhouettes"])


@each_case("prompts", [[], [{"prompt": "a bell", "regions": [{"box": {"min": [-2, 0, -2], "max": [2, 2, 2]}}]}]])
def test_prompts_beside_pictures_run_to_their_end(prompts: list[dict[str, object]]) -> None:
    given = {"silhouettes": BOTH[:1], "steps": 8, "orientation": "keep", "prompts": prompts}
    run = started(GLB, "a vase", **given, pictures=[ellipse(40, 20)])
    losses = [report.losses for report in run]
    assert len(losses) == 8
    assert all({"sds_mse", "silhouette_iou", "guidance"} <= each.keys() for each in losses)
    _, report = finished(run)
    (found,) = report["silhouettes"]
    assert found["iou"] > found["iou_before"] + 0.05
    assert report["guidance"]["id"] == "fake"
    assert report["guidance"]["silhouettes_sha256"]
    assert len(report.get("prompts", [])) == (2 if prompts else 0)


def test_pictures_that_cannot_be_used_are_named() -> None:
    blank = io.BytesIO()
    Image.new("L", (50, 50), 255).save(blank, "PNG")
    with pytest.raises(SilhouetteError, match="`silhouette_2` shows no object"):
        started(GLB, "", **ALONE, silhouettes=BOTH, pictures=[ellipse(40, 20), blank.getvalue()])
    with pytest.raises(ParameterError, match="1 pictures"):
        started(GLB, "", **ALONE, silhouettes=BOTH, pictures=[ellipse(40, 20)])


def test_pictures_on_the_command_line(tmp_path: Path) -> None:
    odd = tmp_path / "a@b.png"
    odd.write_bytes(ellipse(40, 20))
    found = parse_pictures([f"{odd}@0", f"{odd}@-90,15", f"{odd}@45,0,40"])
    assert found.views == [
        {"azimuth": 0},
        {"azimuth": -90, "elevation": 15},
        {"azimuth": 45, "elevation": 0, "fov": 40},
    ]
    assert found.files == {"silhouette_1": odd, "silhouette_2": odd, "silhouette_3": odd}
    assert parse_pictures(None).paths == []
    for wrong in (f"{odd}", f"{odd}@", f"{odd}@front", f"{odd}@1,2,3,4", f"{tmp_path}/none.png@0", "@0"):
        with pytest.raises(typer.BadParameter):
            parse_pictures([wrong])
    with pytest.raises(typer.BadParameter, match="at most 4"):
        parse_pictures([f"{odd}@{turn}" for turn in range(5)])


@each_case("rig", ["keep", "follow"])
def test_a_rig_follows_if_it_is_asked_to_and_the_report_says_so(rig: str) -> None:
    source = arm(targets=True).glb()
    given = {**ALONE, "silhouettes": [{"azimuth": 0}], "steps": 4, "output": {"rig": rig}}
    result, report = finished(started(source, "", **given, pictures=[ellipse(30, 30)]))
    assert report["rig"] == {"mode": rig, "joints": 3, "morph_targets": 1, "animations": 1}
    before, after = Player(source), Player(result)
    moved = [not np.allclose(a[:3, 3], b[:3, 3]) for a, b in zip(before.worlds(None), after.worlds(None), strict=True)]
    # The node of the mesh, the hat, and the armature stay; the joints and the helper move.
    joints = set(before.root["skins"][0]["joints"])
    assert all(moved[joint] for joint in joints) if rig == "follow" else not any(moved)
    # In the bind pose, the skin shows the surface that was optimised.
    np.testing.assert_allclose(
        after.at(None, 0).verts, load_asset(result).surface.positions[: len(after.at(None, 0).verts)], atol=1e-5
    )
    assert bool([text for text in report["warnings"] if "output.rig" in text]) == (rig == "keep")
