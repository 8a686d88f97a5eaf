"""Parse pictures as targets on the command line, and say how well a result fits them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer

__all__ = ["Pictures", "parse_pictures", "silhouettes_line"]

_FORM = "FILE@AZIMUTH or FILE@AZIMUTH,ELEVATION or FILE@AZIMUTH,ELEVATION,FOV, in degrees, such as front.png@0"


@dataclass(frozen=True)
class Pictures:
    """The pictures of a command, and their directions.

    Attributes
    ----------
    paths : list of Path
    views : list of dict
        The parameter `silhouettes`.
    """

    paths: list[Path] = field(default_factory=list)
    views: list[dict[str, float]] = field(default_factory=list)

    @property
    def parts(self) -> dict[str, Path]:
        """The pictures by the names of their parts."""
        from meshdeform.requests.silhouettes import SILHOUETTE_PARTS

        return dict(zip(SILHOUETTE_PARTS, self.paths, strict=False))


def parse_pictures(texts: Sequence[str] | None) -> Pictures:
    """Parse pictures written as FILE@AZIMUTH[,ELEVATION[,FOV]].

    Raises
    ------
    typer.BadParameter
        A text does not have this form, there is no such file, or there are too many.
    """
    from meshdeform.requests.silhouettes import MAX_SILHOUETTES

    found = Pictures()
    for text in texts or ():
        name, _, angles = text.rpartition("@")
        path = Path(name)
        try:
            numbers = [float(part) for part in angles.split(",")]
        except ValueError:
            numbers = []
        if not name or not 1 <= len(numbers) <= 3:
            raise typer.BadParameter(f"{text!r} is not {_FORM}", param_hint="--silhouette")
        if not path.is_file():
            raise typer.BadParameter(f"there is no file {name}", param_hint="--silhouette")
        found.paths.append(path)
        found.views.append(dict(zip(("azimuth", "elevation", "fov"), numbers, strict=False)))
    if len(found.paths) > MAX_SILHOUETTES:
        raise typer.BadParameter(f"at most {MAX_SILHOUETTES} pictures", param_hint="--silhouette")
    return found


def silhouettes_line(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the line for `silhouettes` of a run's summary."""
    views = (f"{each['azimuth']:g} degrees {each['iou_before']:.1%} to {each['iou']:.1%}" for each in found)
    return f"Pictures   overlap of the silhouettes: {'; '.join(views)}"
