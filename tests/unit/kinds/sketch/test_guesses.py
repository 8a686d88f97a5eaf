"""Guesses of drawings with the weights of the package, and the training that makes such weights."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image, ImageDraw

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.drawing import read_drawing
from meshdeform.errors import ModelError, ParameterError
from meshdeform.kinds.sketch.families import FAMILIES
from meshdeform.kinds.sketch.looking import WEIGHTS, guess, is_unsure, look, read_weights
from training.sketch.lines import View, joined, visible_lines
from training.sketch.network import SketchNetwork, write_network
from training.sketch.strokes import draw
from training.sketch.train import make_drawings, make_strangers, train


def drawing(family: str, seed: int, **values: object) -> bytes:
    random = np.random.default_rng(seed)
    mesh = joined(FAMILIES[family].solids(values))
    buffer = io.BytesIO()
    draw(visible_lines(mesh, View(random.uniform(-50, 50), 20, 25)), random, size=256).save(buffer, "PNG")
    return buffer.getvalue()


def test_defaults_of_all_families_are_recognised() -> None:
    right = sum(guess(drawing(name, seed))[0].family == name for name in FAMILIES for seed in range(3))
    assert right >= 16  # of 18


def test_a_drawing_of_something_else_is_unsure_and_those_of_the_families_are_not() -> None:
    page = Image.new("L", (400, 400), 255)
    pen = ImageDraw.Draw(page)
    for box in ((100, 180, 300, 360), (176, 260, 224, 360), (120, 220, 160, 260), (240, 220, 280, 260)):  # a house
        pen.rectangle(box, outline=0, width=4)
    pen.line([(80, 180), (200, 72), (320, 180), (80, 180)], fill=0, width=4)
    buffer = io.BytesIO()
    page.save(buffer, "PNG")
    assert is_unsure(guess(buffer.getvalue()))
    assert not is_unsure(guess(buffer.getvalue(), family="vase"), family="vase")
    unsure = sum(is_unsure(guess(drawing(name, seed))) for name in FAMILIES for seed in range(3))
    assert unsure <= 2  # of 18


def test_numbers_follow_the_drawing() -> None:
    for family, name in (("vase", "belly"), ("airplane", "span"), ("table", "height"), ("chair", "back_height")):
        about = next(number for number in FAMILIES[family].numbers if number.name == name)
        small, large = (
            np.mean([float(guess(drawing(family, s, **{name: at}), family=family)[0].values[name]) for s in (1, 2)])
            for at in (about.low, about.high)
        )
        assert large - small > 0.25 * (about.high - about.low), (family, name)


def test_three_guesses_are_meshes_of_different_families() -> None:
    found = guess(drawing("goblet", 4))
    assert len({each.family for each in found}) == 3
    assert [each.probability for each in found] == sorted((each.probability for each in found), reverse=True)
    for each in found:
        FAMILIES[each.family].checked(each.values)
        surface = load_asset(each.glb(), "shape.glb", Limits.unlimited()).surface
        assert len(surface.triangles) == sum(len(s.faces) for s in FAMILIES[each.family].solids(each.values).values())
    assert [each.family for each in guess(drawing("goblet", 4), family="lamp")] == ["lamp"]
    with pytest.raises(ParameterError, match="no family"):
        guess(drawing("goblet", 4), family="dragon")


def in_torch(weights: Mapping[str, np.ndarray]) -> SketchNetwork:
    network = SketchNetwork()
    network.load_state_dict({name: torch.from_numpy(np.array(each)) for name, each in weights.items()})
    return network.eval()


def test_weights_are_small_and_read_alike_with_and_without_torch(tmp_path: Path) -> None:
    assert WEIGHTS.stat().st_size < 10_000_000
    picture = read_drawing(drawing("vase", 1))
    seen = look(picture, read_weights())
    with torch.no_grad():
        expected = in_torch(read_weights())(torch.from_numpy(picture)[None, None])
    np.testing.assert_allclose(seen.probabilities, expected.family[0].softmax(0), atol=1e-5)
    for name in FAMILIES:
        np.testing.assert_allclose(seen.shares[name], expected.numbers[name][0], atol=1e-5)
        assert seen.options[name] == [int(each[0].argmax()) for each in expected.choices[name]]
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(WEIGHTS.read_bytes()[:5000])
    with pytest.raises(ModelError, match="cannot be read"):
        read_weights(damaged)


def test_weights_of_other_families_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("training.sketch.network.parameters_hash", lambda: "another")
        write_network(tmp_path / "other.safetensors", SketchNetwork(), {})
    with pytest.raises(ModelError, match="other families"):
        read_weights(tmp_path / "other.safetensors")


def test_training_learns_repeats_and_its_weights_load(tmp_path: Path) -> None:
    drawings = make_drawings(12, 5).with_more(make_strangers(4, 5))
    lines: list[str] = []
    first, second = (train(drawings, 6, 0, lines.append) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters(), strict=True))
    sums = [float(line.split("family ")[1].split()[0]) for line in lines[:6]]
    assert sums[-1] < sums[0]
    write_network(tmp_path / "made.safetensors", first, {})
    in_torch(read_weights(tmp_path / "made.safetensors"))
