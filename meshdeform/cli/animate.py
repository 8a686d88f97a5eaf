"""`meshdeform animate`: an animated picture of a result, for pages and messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.local import check_free, write_all
from meshdeform.cli.options import ForceOption
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["animate", "check_animation", "drawn_animation"]

_DEFAULT = Path("animation.webp")
_SUFFIXES = (".webp", ".gif")


@clean_errors
def animate(
    source: Annotated[Path, typer.Argument(help="The asset before; alone: the asset to turn.", exists=True)],
    result: Annotated[Path | None, typer.Argument(help="Its deformed GLB.", exists=True, show_default=False)] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The .webp or .gif to write.")] = _DEFAULT,
    force: ForceOption = False,
) -> None:
    """Draw SOURCE becoming RESULT and back, or one turn of SOURCE.

    meshdeform animate examples/sphere.glb mushroom.glb -o mushroom.webp

    meshdeform animate mushroom.glb -o turn.gif
    """
    require("torch", "deform")
    check_animation(output, "--output")
    check_free([output], [source, result], force=force)
    write_all({output: drawn_animation(source, result, output.suffix, load_settings())}, what=output)
    typer.echo(output)


def check_animation(path: Path, option: str) -> None:
    """Refuse a path whose suffix names no animated format, as a `typer.BadParameter`."""
    if path.suffix.lower() not in _SUFFIXES:
        raise typer.BadParameter(f"{path.name} ends in neither .webp nor .gif", param_hint=option)


def drawn_animation(source: Path, result: Path | None, suffix: str, settings: Settings) -> bytes:
    """Return a picture of a source that becomes its result, or of one turn of a source without one."""
    from meshdeform.assets import Limits, load_asset
    from meshdeform.assets.bundle import read_with_files
    from meshdeform.rendering.animation import FORMATS, morph_animation, turntable_animation
    from meshdeform.rendering.studio import Pose
    from meshdeform.runs.devices import use_threads
    from meshdeform.runs.preparation import read_result, subdivided

    use_threads(settings.threads)
    limits = Limits.from_settings(settings)
    asset = load_asset(read_with_files(source, limits), source.name, limits)
    before, kind = Pose(asset.surface.positions, asset.surface.normals), FORMATS[suffix.lower()]
    if result is None:
        return turntable_animation(asset.appearance(), before, kind=kind)
    after = read_result(result.read_bytes()).surface
    if len(asset.surface.triangles) < len(after.triangles):
        asset, _ = subdivided(asset, limits)
        before = Pose(asset.surface.positions, asset.surface.normals)
    if asset.surface.triangles.tobytes() != after.triangles.tobytes():
        raise ParameterError(
            f"{result.name} was not made from {source.name}: their triangles differ.",
            advice="Name the asset that was deformed, then its result.",
        )
    return morph_animation(asset.appearance(), before, Pose(after.positions, after.normals), kind=kind)
