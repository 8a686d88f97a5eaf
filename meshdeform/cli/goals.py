"""Read from the command line what a deformation aims at: a prompt, or a target mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer

__all__ = ["Goals", "parse_goals"]


@dataclass(frozen=True)
class Goals:
    """The goals of a job.

    Attributes
    ----------
    params : dict
        `guidance`, unless there is neither a target nor a drawing.
    files : dict of str to Path
        The target mesh or the drawing, by part.
    """

    params: dict[str, Any] = field(default_factory=dict)
    files: dict[str, Path] = field(default_factory=dict)


def parse_goals(target: Path | None, sketch: Path | None = None, output: Path | None = None) -> Goals:
    """Return the goals for `--target` and `--sketch`.

    The target of a drawing is the file `OUTPUT.target.glb`, which is still to be made; without an output, the drawing
    itself is a file of the job.

    Raises
    ------
    typer.BadParameter
        Both are given.
    """
    if target is not None and sketch is not None:
        raise typer.BadParameter("--target and --sketch exclude each other", param_hint="--sketch")
    if sketch is not None:
        drawn = {"sketch": sketch} if output is None else {"target": output.with_suffix(".target.glb")}
        return Goals({"guidance": "target"}, drawn)
    return Goals({"guidance": "target"}, {"target": target}) if target is not None else Goals()
