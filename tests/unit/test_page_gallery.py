"""The examples that come with the page: each result is its source in another shape, made by the request beside it."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from meshdeform.assets import load_asset
from meshdeform.requests.document import JobRequest, resolve
from meshdeform.runs.base import sha256_hex
from tests.cases import each_case

FOLDER = Path(__file__).parents[2] / "service" / "web" / "examples"
EXAMPLES: list[dict[str, Any]] = json.loads((FOLDER / "gallery.json").read_text())["examples"]
LARGEST_BYTES = 1_500_000


def recorded(glb: bytes) -> dict[str, Any]:
    """What a result says about the request that made it."""
    (length,) = struct.unpack_from("<I", glb, 12)
    found: dict[str, Any] = json.loads(glb[20 : 20 + length])["asset"]["extras"]["meshdeform"]
    return found


def test_the_examples_are_named_once_and_small_together() -> None:
    names = [example["id"] for example in EXAMPLES]
    assert len(names) == len(set(names)) >= 6
    held = {path.name for path in (FOLDER / "gallery").iterdir()}
    assert held == {f"{name}.{ending}" for name in names for ending in ("glb", "webp")}
    assert sum(path.stat().st_size for path in (FOLDER / "gallery").iterdir()) < LARGEST_BYTES


@each_case("example", EXAMPLES, ids=lambda example: example["id"])
def test_a_result_is_its_source_in_another_shape_by_the_request_beside_it(example: dict[str, Any]) -> None:
    data, made = (FOLDER / example["asset"]).read_bytes(), (FOLDER / example["result"]).read_bytes()
    source, result = load_asset(data).surface, load_asset(made).surface
    np.testing.assert_array_equal(result.triangles, source.triangles)
    assert result.positions.shape == source.positions.shape
    moved = np.linalg.norm(result.positions - source.positions, axis=1)
    assert np.sqrt((moved**2).mean()) > 0.02 * np.linalg.norm(np.ptp(source.positions, axis=0))
    for region in example["document"]["params"].get("control", {}).get("regions", []):
        low, high = region["box"]["min"], region["box"]["max"]
        inside = ((source.positions >= low) & (source.positions <= high)).all(1)
        kept = np.unique(source.triangles[inside[source.triangles].all(1)])
        assert len(kept) > 100
        assert not moved[kept].any()
    _check_request(example)
    _check_picture(example)


def _check_request(example: dict[str, Any]) -> None:
    request = JobRequest.model_validate(example["document"])
    params = resolve(request.params)
    said = recorded((FOLDER / example["result"]).read_bytes())
    assert {name: said[name] for name in ("prompt", "seed", "preset", "step")} == {
        "prompt": request.prompt,
        "seed": params.seed,
        "preset": params.preset.value,
        "step": params.steps,
    }
    assert said["source_sha256"] == sha256_hex((FOLDER / example["asset"]).read_bytes())
    assert example["report"]["quality"]["flipped_faces"] == 0
    assert example["report"]["likeness"]["matches"] is True


def _check_picture(example: dict[str, Any]) -> None:
    """It has both side by side."""
    picture = Image.open(io.BytesIO((FOLDER / example["picture"]).read_bytes()))
    assert (picture.format, picture.width) == ("WEBP", 2 * picture.height)
    pixels = np.asarray(picture.convert("RGB"), dtype=np.int16)
    halves = pixels[:, : picture.height], pixels[:, picture.height :]
    assert np.abs(halves[0] - halves[1]).max() > 60
    assert min(half.std() for half in halves) > 5
