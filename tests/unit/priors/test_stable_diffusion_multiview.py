"""The multi-view prior, on the real classes of Stable Diffusion 2 with random weights and a random adapter."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import safetensors.torch
import torch
from torch import Tensor, nn

from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.orientation import OrientationSource
from meshdeform.errors import ModelError, ShapeError
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors import check_model, load_prior
from meshdeform.priors.catalogue import list_models
from meshdeform.priors.model_files import PartFiles
from meshdeform.priors.multiview.network import AdapterModules, RowAttention, camera_planes
from meshdeform.priors.multiview.prior import RIG, MultiViewPrior, shifted
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.rendering.cameras import Cameras, rig_cameras
from meshdeform.requests.choices import Encoder
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.testing import build_tiny_stable_diffusion
from tests.cases import each_case
from tests.close import assert_close
from tests.unit.priors.multi_view import FILE, LAYERS, adapter_tensors, with_adapter

CAMERAS = rig_cameras(RIG, 1.0)
VIEWS = len(RIG.azimuths_deg)
AT = torch.full((VIEWS,), 400)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_tiny_stable_diffusion(tmp_path_factory.mktemp("second"), edition=2, tiny_encoder=True)


@pytest.fixture(scope="module")
def folder(base: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_adapter(base, tmp_path_factory.mktemp("models") / "multiview")


@pytest.fixture(scope="module")
def prior(folder: Path) -> MultiViewPrior:
    found = load_prior(str(folder), device="cpu")
    assert isinstance(found, MultiViewPrior)
    return found


def latents(seed: int = 0) -> Tensor:
    return torch.randn(VIEWS, 4, 16, 16, generator=torch.Generator().manual_seed(seed))


def predicted(prior: StableDiffusionPrior, z_t: Tensor, cameras: Cameras = CAMERAS) -> Tensor:
    return torch.stack(prior.predict_noise(z_t, AT, prior.encode_texts("a pear", ""), cameras))


def chosen(cameras: Cameras, order: list[int]) -> Cameras:
    places = cameras.azimuths_deg, cameras.elevation_deg
    azimuths, elevations = (tuple(each[k] for k in order) for each in places)
    return replace(cameras, azimuths_deg=azimuths, elevation_deg=elevations)


def test_each_row_attends_to_the_same_row_of_all_views() -> None:
    """Against a loop over sets, heads, rows and views."""
    from diffusers.models.attention_processor import Attention, AttnProcessor2_0

    sets, views, side, heads, width = 2, 3, 4, 2, 16
    generator = torch.Generator().manual_seed(3)
    layer = Attention(width, heads=heads, dim_head=width // heads, processor=AttnProcessor2_0())
    row = RowAttention(width, views, layer.processor)
    for parameter in (*layer.parameters(), *row.parameters()):
        nn.init.normal_(parameter, std=0.4, generator=generator)
    tokens = torch.randn(sets * views, side * side, width, generator=generator)
    with torch.no_grad():
        query, key, value = (
            to(tokens).view(sets, views, side, side, heads, -1) for to in (row.to_q_mv, row.to_k_mv, row.to_v_mv)
        )
        mixed = torch.zeros_like(query)
        for s in range(sets):
            for r in range(side):
                for h in range(heads):
                    keys, values = (each[s, :, r, :, h].reshape(views * side, -1) for each in (key, value))
                    for v in range(views):
                        scores = query[s, v, r, :, h] @ keys.T / math.sqrt(width / heads)
                        mixed[s, v, r, :, h] = scores.softmax(-1) @ values
        expected = layer(tokens) + row.to_out_mv[0](mixed.view(tokens.shape))
        layer.set_processor(row)
        assert_close(layer(tokens), expected, rtol=1e-4, atol=1e-5)


def test_the_tensors_at_true_size_are_those_of_the_published_file() -> None:
    """The names and shapes for Stable Diffusion 2.1, on no device."""
    from diffusers import UNet2DConditionModel

    with torch.device("meta"):
        heads = (5, 10, 20, 20)
        unet = UNet2DConditionModel(cross_attention_dim=1024, attention_head_dim=heads, use_linear_projection=True)
    found = AdapterModules.of(unet, views=6, shrink=8).tensors()
    shapes = {name: tuple(tensor.shape) for name, tensor in found.items()}
    rows = {name: shape for name, shape in shapes.items() if "_mv" in name}
    assert len(rows) == 16 * 5
    first, last = "down_blocks.0.attentions.0", "up_blocks.3.attentions.2"
    assert rows[f"{first}.transformer_blocks.0.attn1.processor.to_q_mv.weight"] == (320, 320)
    assert rows[f"{last}.transformer_blocks.0.attn1.processor.to_out_mv.0.bias"] == (320,)
    assert rows["mid_block.attentions.0.transformer_blocks.0.attn1.processor.to_v_mv.weight"] == (1280, 1280)
    assert shapes["adapter.conv_in.weight"] == (320, 6 * 64, 3, 3)
    assert shapes["adapter.body.2.in_conv.weight"] == (1280, 640, 1, 1)
    assert shapes["adapter.body.3.resnets.1.block2.weight"] == (1280, 1280, 1, 1)


def test_an_adapter_of_zeros_leaves_the_base_as_it_is_view_by_view(base: Path, tmp_path: Path) -> None:
    plain = StableDiffusionPrior(str(base))
    nothing = {name: torch.zeros_like(tensor) for name, tensor in adapter_tensors().items()}
    with_zeros = MultiViewPrior(str(with_adapter(base, tmp_path / "zeros", nothing)))
    single = [
        torch.stack(plain.predict_noise(view[None], AT[:1], plain.encode_texts("a pear", ""), CAMERAS))[:, 0]
        for view in latents()
    ]
    assert_close(predicted(with_zeros, latents()), torch.stack(single, 1), rtol=1e-4, atol=1e-5)


def test_views_in_another_order_are_predicted_in_that_order(prior: MultiViewPrior) -> None:
    order = [3, 0, 5, 1, 4, 2]
    usual = predicted(prior, latents())
    assert_close(predicted(prior, latents()[order], chosen(CAMERAS, order)), usual[:, order], rtol=1e-3, atol=1e-4)
    # The same pictures under other cameras are predicted otherwise, so the cameras are seen.
    assert not torch.allclose(predicted(prior, latents(), chosen(CAMERAS, order)), usual, atol=1e-2)


def test_views_see_each_other_only_through_the_attention_across_them(base: Path, tmp_path: Path) -> None:
    tensors = adapter_tensors()
    apart = {name: torch.zeros_like(each) if "to_out_mv" in name else each for name, each in tensors.items()}
    changed = latents()
    changed[0] = latents(seed=1)[0]
    for name, given, seen in (("joined", tensors, True), ("apart", apart, False)):
        one = MultiViewPrior(str(with_adapter(base, tmp_path / name, given)))
        before, after = predicted(one, latents())[:, 1:], predicted(one, changed)[:, 1:]
        assert torch.allclose(before, after, atol=1e-5) is not seen
        assert not seen or float((before - after).abs().amax((1, 2, 3, 4)).min()) > 1e-2


def test_the_planes_of_a_camera_are_its_rays_and_its_place_in_the_frame_of_the_training() -> None:
    """The frame has +Z up and the front at -Y: ours turned by a quarter about the x axis."""
    found = camera_planes((0.0, 90.0, 225.0), (0.0, 0.0, 30.0), 4)
    assert found.shape == (3, 6, 4, 4)
    assert torch.equal(found, found[:, :, :1, :1].expand(-1, -1, 4, 4))
    values = 2 * found[:, :, 0, 0] - 1
    half, level = math.sqrt(0.5), math.cos(math.radians(30))
    eyes = [[0, -1, 0], [1, 0, 0], [-half * level, half * level, 0.5]]
    assert_close(values[:, 3:], torch.tensor(eyes), rtol=0, atol=1e-6)
    assert_close(values[:, :3], -values[:, 3:], rtol=0, atol=1e-6)
    ours = nn.functional.normalize(CAMERAS.eye, dim=1)
    turned = torch.stack([ours[:, 0], -ours[:, 2], ours[:, 1]], 1)
    planes = camera_planes(CAMERAS.azimuths_deg, CAMERAS.elevation_deg, 1)[:, 3:, 0, 0]
    assert_close(2 * planes - 1, turned, rtol=0, atol=1e-5)


def test_the_schedule_is_noisier_towards_its_end() -> None:
    usual = torch.tensor([0.999, 0.6, 0.2, 0.0])
    found = shifted(usual)
    ratio = usual / (1 - usual) / torch.tensor([1.0, 2.0, 4.0, 8.0])
    assert_close(found, ratio / (1 + ratio), rtol=1e-5, atol=1e-7)
    assert float(found[0]) == pytest.approx(0.999, rel=1e-6)
    assert float(found[-1]) == 0.0


def guided(prior: MultiViewPrior, **params: Any) -> Deformation:
    settings = {"preset": "preview", "steps": 3, "safeguard": "none", "appearance": "clay", **params}
    resolved = resolve(DeformParams.model_validate(settings), default_model="a/b")
    guidance = ScoreDistillation(prior, "a pear", guidance_scale=10.0)
    return Deformation(icosphere(2, 0.6), guidance, resolved)


def test_six_views_at_one_noise_level_pull_at_the_vertices_and_a_run_resumes_bit_for_bit(
    prior: MultiViewPrior, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def spy(z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras) -> tuple[Tensor, ...]:
        asked.append((z_t.shape, timestep.tolist(), cameras.azimuths_deg))
        return MultiViewPrior.predict_noise(prior, z_t, timestep, embedding, cameras)

    monkeypatch.setattr(prior, "predict_noise", spy)
    whole = guided(prior, orientation=20.0)
    list(whole)
    assert [(shape, len(set(timesteps))) for shape, timesteps, _ in asked] == [((VIEWS, 4, 16, 16), 1)] * 3
    assert {azimuths for *_, azimuths in asked} == {RIG.azimuths_deg}, "from the front, wherever that is"
    assert len({timesteps[0] for _, timesteps, _ in asked}) == 3
    assert float(whole.checkpoint().tensors["jacobians.exp_avg"].abs().min(0).values.max()) > 0
    begun = guided(prior, orientation=20.0)
    next(iter(begun))
    resumed = guided(prior, orientation=20.0)
    resumed.restore(begun.checkpoint())
    list(resumed)
    assert torch.equal(resumed.verts(), whole.verts())


def test_a_sphere_fills_the_share_of_the_view_that_the_training_gave_it(prior: MultiViewPrior) -> None:
    """Orthographic: a disc whose area is known, on grey, from every side, whatever the parameters of the cameras."""
    run = guided(prior, elevation_min_deg=60.0, elevation_max_deg=80.0, framing=0.3, framing_max=0.3)
    cameras = run._views.sample(torch.Generator(), run._framing.fitting_radius(0.6, 0.6))
    pictures = run._views.arrange(run._renderer.render(icosphere(2, 0.6).verts.float(), cameras))
    assert pictures.shape == (VIEWS, 3, 128, 128)
    assert_close(pictures[:, :, 0, 0], torch.full((VIEWS, 3), 0.5))
    shown = (pictures != 0.5).any(1).float().mean((1, 2))
    assert_close(shown, torch.full((VIEWS,), math.pi / 4 * RIG.share**2), rtol=0.04, atol=0)


def test_the_front_can_be_searched_because_the_model_knows_the_sides(prior: MultiViewPrior) -> None:
    found = guided(prior, orientation="auto").orientation
    assert found.source in (OrientationSource.FOUND, OrientationSource.UNDECIDED)
    assert len(set(found.grades)) > 1


def test_the_small_encoder_and_the_identity(prior: MultiViewPrior, folder: Path) -> None:
    small = prior.with_encoder(Encoder.TINY)
    assert isinstance(small, MultiViewPrior)
    assert small.encode_image(torch.rand(VIEWS, 3, 128, 128)).shape == (VIEWS, 4, 16, 16)
    assert small.identity["adapter"] == prior.identity["adapter"] == FILE
    assert prior.identity["adapter_sha256"] == PartFiles("", (folder / FILE,)).sha256()
    with pytest.raises(ShapeError, match="expected the 6 cameras of the model, got 4"):
        predicted(prior, latents()[:4], chosen(CAMERAS, [0, 1, 2, 3]))


def test_a_base_for_larger_pictures_sees_those_of_the_adapters_training(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("meshdeform.priors.multiview.prior._SIDE", 8)
    found = MultiViewPrior(str(with_adapter(base, tmp_path / "large")))
    assert (found.image_size, found.style.view_size) == (64, 64)


def test_the_list_of_models_says_what_it_is_and_both_licences(folder: Path, tmp_path: Path) -> None:
    carded = shutil.copytree(folder, tmp_path / "carded")
    (carded / "README.md").write_text("---\nlicense: openrail++\n---\n# A model\n")
    found = list_models(str(carded), [str(folder)])
    assert [model.available for model in found] == [True] * 3
    assert "six sides" in found[0].description
    assert found[0].licence == "openrail++; adapter: Apache-2.0"
    assert found[2].licence == "checkpoint: see its model card; adapter: Apache-2.0"


def edited(edit: Callable[[dict[str, Tensor]], object]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        tensors = safetensors.torch.load_file(folder / FILE)
        edit(tensors)
        safetensors.torch.save_file(tensors, folder / FILE, {"format": "pt"})

    return spoil


def of_first_edition(folder: Path) -> None:
    path = folder / "unet" / "config.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"use_linear_projection": False}))


FIRST = next(iter(LAYERS))
QUERY = f"{FIRST}.to_q_mv.weight"
AT_THE_DOOR: list[tuple[Callable[[Path], object], str]] = [
    (lambda at: (at / FILE).rename(at / "mvadapter_i2mv_sd21.safetensors"), "has mvadapter_i2mv_sd21.safetensors"),
    (lambda at: (at / FILE).rename(at / "mvadapter_t2mv_sd21.ckpt"), "has mvadapter_t2mv_sd21.ckpt; Meshdeform reads"),
    (lambda at: (at / FILE).write_bytes((at / FILE).read_bytes()[:5000]), "cannot be read"),
    (lambda at: (at / FILE).write_bytes(b"version https://git-lfs.github.com/spec/v1"), "cannot be read"),
    (edited(lambda has: has.update({f"{FIRST}.to_k_ref.weight": torch.zeros(32, 32)})), "1 tensors of another"),
    (of_first_edition, "a U-Net of another family"),
]
WHEN_LOADED: list[tuple[Callable[[Path], object], str]] = [
    (edited(lambda has: has.pop(QUERY)), rf"lacks 1 tensors, such as {QUERY} \(32, 32\)"),
    (edited(lambda has: has.update({QUERY: torch.zeros(64, 64)})), r"with \(64, 64\) in place of \(32, 32\)"),
    (edited(lambda has: has.update({QUERY.replace("0", "3", 1): torch.zeros(2)})), "belong to no layer, such as down_"),
]


@each_case(
    "spoil, message, early",
    [*((*case, True) for case in AT_THE_DOOR), *((*case, False) for case in WHEN_LOADED)],
    ids=[message[:30] for _, message in (*AT_THE_DOOR, *WHEN_LOADED)],
)
def test_an_adapter_that_does_not_fit_is_one_clear_error(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, spoil: Callable[[Path], object], message: str, early: bool
) -> None:
    copy = shutil.copytree(folder, tmp_path_factory.mktemp("spoiled") / "copy")
    spoil(copy)
    if early:
        with pytest.raises(ModelError, match=message):
            check_model(str(copy))
    else:
        check_model(str(copy))
    with pytest.raises(ModelError, match=message) as caught:
        load_prior(str(copy), device="cpu")
    assert caught.value.advice_text
