"""Names of downloaded files."""

from __future__ import annotations

from meshdeform.support.files import result_name
from tests.cases import each_case


@each_case(
    ("artifact", "asset", "goal", "seed", "name"),
    [
        ("result.glb", "duck.glb", "a tall vase", 7, "duck-a-tall-vase-seed7.glb"),
        ("preview.png", "duck.glb", "a tall vase", 7, "duck-a-tall-vase-seed7.preview.png"),
        ("result.stl", "C:\\models\\my duck.v2.obj", "like egg", 0, "my-duck-v2-like-egg-seed0.stl"),
        ("result.glb", "../../etc/passwd", 'x\r\n"; rm', None, "passwd-x-rm.glb"),
        ("result.glb", "", "a vase", 0, "a-vase-seed0.glb"),
        ("result.glb", "..", "///", None, "result.glb"),
        ("result.glb", "ente.glb", "größe " * 100, None, "ente-" + ("größe-" * 8)[:-1] + ".glb"),
    ],
)
def test_a_download_is_named_after_asset_prompt_and_seed(
    artifact: str, asset: str, goal: str, seed: int | None, name: str
) -> None:
    assert result_name(artifact, source=asset, goal=goal, seed=seed) == name
