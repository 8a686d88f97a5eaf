"""`meshdeform animate`: an animated picture of a result, for pages and messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.errors import ParameterError, UnavailableError

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["animate", "check_animation", "write_animation"]

_DEFAULT = Path("animation.webp")
_SUFFIXES = (".webp", ".gif")


@clean_errors
def animate(
    source: Annotated[Path, typer.Argument(help="The asset before; alone: the asset to turn.", exists=True)],
    result: Annotated[Path | None, typer.Argument(help="Its deformed GLB.", exists=True, show_default=False)] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The .webp or .gif to write.")] = _DEFAULT,
) -> None:
    """Draw SOURCE becoming RESULT and back, or one turn of SOURCE.

    meshdeform animate examples/sphere.glb mushroom.glb -o mushroom.webp

    meshdeform animate mushroom.glb -o turn.gif
    """
    require("torch", "deform")
    check_animation(output, "--output")
    write_animation(source, result, output, load_settings())
    typer.echo(output)


def check_animation(path: Path, option: str) -> None:
    """Refuse a path whose suffix names no animated format.

    Raises
    ------
    typer.BadParameter
    """
    if path.suffix.lower() not in _SUFFIXES:
        raise typer.BadParameter(f"{path.name} ends in neither .webp nor .gif", param_hint=option)


def write_animation(source: Path, result: Path | None, path: Path, settings: Settings) -> None:
    """Draw a source that becomes its result, or one turn of the source if there is no result.

    Raises
    ------
    AssetError, ParameterError
        A file cannot be read, or the result was not made from the source.
    UnavailableError
        The animation cannot be written.
    """
    from meshdeform.assets import Limits, load_asset
    from meshdeform.assets.bundle import read_with_files
    from meshdeform.rendering.animation import FORMATS, morph_animation, turntable_animation
    from meshdeform.rendering.studio import Pose
    from meshdeform.runs.devices import use_threads
    from meshdeform.runs.preparation import read_result, subdivided
    from meshdeform.support.files import write_files

    use_threads(settings.threads)
    limits = Limits.from_settings(settings)
    asset = load_asset(read_with_files(source, limits), source.name, limits)
    before, kind = Pose(asset.surface.positions, asset.surface.normals), FORMATS[path.suffix.lower()]
    if result is None:
        data = turntable_animation(asset.appearance(), before, kind=kind)
    else:
        after = read_result(result.read_bytes()).surface
        if len(asset.surface.triangles) < len(after.triangles):
            asset, _ = subdivided(asset, limits)
            before = Pose(asset.surface.positions, asset.surface.normals)
        if asset.surface.triangles.tobytes() != after.triangles.tobytes():
            raise ParameterError(
                f"{result.name} was not made from {source.name}: their triangles differ.",
                advice="Name the asset that was deformed, then its result.",
            )
        data = morph_animation(asset.appearance(), before, Pose(after.positions, after.normals), kind=kind)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_files({path: data})
    except OSError as error:
        raise UnavailableError(f"{path} cannot be written: {error}.", advice="Choose another place.") from error
