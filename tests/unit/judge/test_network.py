"""The judge's network in numpy: what it said when it was written, and what torch says."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.geometry.shapes import icosphere
from meshdeform.judge.network import JudgeConfig, JudgeWeights, Network, read_weights
from meshdeform.judge.scoring import draw_views, judging_cameras
from training.shapes import box, cylinder, torus


def tiny(seed: int) -> JudgeWeights:
    """A network of other sizes with random weights, in which every part has an effect."""
    random = np.random.default_rng(seed)
    config = JudgeConfig(("one", "two", "three"), 5, (6, 7, 9))
    state = {name: random.normal(0, 0.3, shape).astype(np.float32) for name, shape in config.shapes().items()}
    for name, each in state.items():
        if name.endswith("running_var"):
            state[name] = each**2 + np.float32(0.1)
    return JudgeWeights(config, state, {})


KNOWN = [[-0.126973, 0.182237, -0.355965]]


def test_it_finds_what_it_found_before() -> None:
    """Logits of a ramp by random weights, as torch gave them."""
    ramp = np.linspace(0, 1, 64 * 64, dtype=np.float32).reshape(1, 64, 64)
    np.testing.assert_allclose(Network(tiny(0)).logits(ramp), KNOWN, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("weights", [tiny(1), read_weights()], ids=["random", "shipped"])
def test_torch_agrees(weights: JudgeWeights) -> None:
    """Both on the judge's own views of shapes."""
    torch = pytest.importorskip("torch")
    from training.judge.network import JudgeNetwork

    network = JudgeNetwork(weights.config).eval()
    network.load_state_dict({name: torch.from_numpy(each) for name, each in weights.state.items()}, strict=False)
    ours = Network(weights)
    assert ours.sharpness == pytest.approx(float(network.sharpness))
    for mesh in (icosphere(3), box(4), cylinder(0.5, 1.5), torus()):
        views = draw_views(mesh, judging_cameras())
        with torch.no_grad():
            expected = network(torch.from_numpy(views)[:, None])
        found = ours.logits(views)
        shares, wanted = (torch.softmax(each * ours.sharpness, -1) for each in (torch.from_numpy(found), expected))
        assert float((shares - wanted).abs().max()) < 1e-5
        np.testing.assert_allclose(found, expected, atol=1e-3)
