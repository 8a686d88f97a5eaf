"""Write a Shap-E pipeline of the real classes with small random weights, whose decoder makes a known shape.

The decoder's bias is an ellipsoid that is tallest along +Z, as Shap-E's meshes are; its latent changes it a little.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import torch

from meshdeform.testing import _END, _START, _write_byte_tokenizer

__all__ = ["build_tiny_shap_e", "marching_cubes"]

_WIDTH, _LATENT = 8, 8
_FEATURES = 93  # a position, and sine and cosine of 15 octaves of it
_COSINES = slice(48, 51)
_AXES = torch.tensor([6.0, 4.0, 2.0])
_OFFSET = 10.0  # from where silu is the identity


def build_tiny_shap_e(folder: Path, *, seed: int = 0, empty: bool = False) -> Path:
    """Write the pipeline into a folder, with a model card; `empty`: there is no surface anywhere."""
    from diffusers import HeunDiscreteScheduler, PriorTransformer, ShapEPipeline
    from diffusers.pipelines.shap_e.renderer import ShapERenderer
    from transformers import CLIPTextConfig, CLIPTextModelWithProjection, CLIPTokenizer

    with tempfile.TemporaryDirectory() as scratch:
        vocabulary = _write_byte_tokenizer(Path(scratch))
        tokenizer = CLIPTokenizer.from_pretrained(scratch, model_max_length=77)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        text_encoder = CLIPTextModelWithProjection(
            CLIPTextConfig(
                vocab_size=len(vocabulary), hidden_size=16, intermediate_size=16, num_hidden_layers=1,
                num_attention_heads=2, projection_dim=16, max_position_embeddings=77,
                bos_token_id=vocabulary[_START], eos_token_id=vocabulary[_END], pad_token_id=vocabulary[_END],
            )
        )  # fmt: skip
        prior = PriorTransformer(
            num_attention_heads=2, attention_head_dim=8, num_layers=1, embedding_dim=_LATENT, num_embeddings=_WIDTH,
            additional_embeddings=0, time_embed_act_fn="gelu", norm_in_type="layer", embedding_proj_norm_type=None,
            encoder_hid_proj_type=None, added_emb_type=None, time_embed_dim=16, embedding_proj_dim=16,
            clip_embed_dim=2 * _LATENT,
        )  # fmt: skip
        renderer = ShapERenderer(
            param_names=("nerstf.mlp.0.weight",), param_shapes=((_WIDTH, _FEATURES),), d_latent=_LATENT,
            d_hidden=_WIDTH, n_output=12, n_hidden_layers=1, insert_direction_at=None,
        )  # fmt: skip
    _shape(renderer, empty=empty)
    renderer.mesh_decoder.cases, renderer.mesh_decoder.masks = marching_cubes()
    scheduler = HeunDiscreteScheduler(
        beta_schedule="exp", num_train_timesteps=1024, prediction_type="sample", use_karras_sigmas=True,
        clip_sample=True, clip_sample_range=1.0,
    )  # fmt: skip
    ShapEPipeline(prior, text_encoder, tokenizer, scheduler, renderer).save_pretrained(folder)
    (folder / "README.md").write_text("---\nlicense: mit\n---\n# Random weights\n")
    return folder


@torch.no_grad()
def _shape(renderer: torch.nn.Module, *, empty: bool) -> None:
    """Let the signed distance be a sum of cosines, minus a constant: the surface is nearly an ellipsoid."""
    (projection,) = renderer.params_proj.projections.values()
    projection.norm.weight.fill_(0.002)
    projection.norm.bias.zero_()
    projection.proj.bias.zero_()
    projection.proj.bias.view(_WIDTH, _FEATURES)[0, _COSINES] = _AXES
    first, second = renderer.mlp.mlp
    first.bias.fill_(0.0)
    first.bias[0] = _OFFSET
    second.weight[0].zero_()
    second.weight[0, 0] = 1.0
    second.bias[0] = -_OFFSET - float(_AXES.sum()) + (-1.0 if empty else 0.8)


def marching_cubes() -> tuple[torch.Tensor, torch.Tensor]:
    """Return the table that the published weights carry: triangles (256, 5, 3) of edges, and which there are.

    A corner (x, y, z) is bit x + 2 y + 4 z. On each side of the cube, a line separates every run of corners inside; the
    lines of all sides form loops.
    """
    edges = {}
    for axis in range(3):
        low, high = [other for other in range(3) if other != axis]
        for number in range(4):
            ends = []
            for end in range(2):
                corner = [0, 0, 0]
                corner[axis], corner[low], corner[high] = end, number & 1, number >> 1
                ends.append(corner[0] + 2 * corner[1] + 4 * corner[2])
            edges[frozenset(ends)] = 4 * axis + number
    sides = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]
    cases, masks = torch.zeros(256, 5, 3, dtype=torch.long), torch.zeros(256, 5, dtype=torch.bool)
    for case in range(256):
        following = {}
        for side in sides:
            inside = [bool(case >> corner & 1) for corner in side]
            for k in range(4):
                if inside[k] and not inside[(k + 1) % 4]:
                    first = k
                    while inside[first - 1]:
                        first -= 1
                    leaves = edges[frozenset((side[k], side[(k + 1) % 4]))]
                    following[leaves] = edges[frozenset((side[first], side[first - 1]))]
        triangles = []
        while following:
            loop = [next(iter(following))]
            while (after := following.pop(loop[-1])) != loop[0]:
                loop.append(after)
            triangles += [(loop[0], loop[k], loop[k + 1]) for k in range(1, len(loop) - 1)]
        if len(triangles) <= 5:  # a few rare cases need more with this rule
            for number, triangle in enumerate(triangles):
                cases[case, number], masks[case, number] = torch.tensor(triangle), True
    return cases, masks
