"""Read from the command line what a deformation aims at: a prompt, a target mesh, or several in a row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer

__all__ = ["Goals", "parse_goals", "stage_words"]

_MESHES = frozenset({".glb", ".gltf", ".obj", ".ply", ".stl", ".zip"})


@dataclass(frozen=True)
class Goals:
    """The goals of a job.

    Attributes
    ----------
    params : dict
        `guidance` and `stages` of its parameters; None for what was not given.
    files : dict of str to Path
        Target meshes, or a drawing, by part.
    """

    params: dict[str, Any] = field(default_factory=dict)
    files: dict[str, Path] = field(default_factory=dict)


def parse_goals(
    target: Path | None,
    stages: Sequence[str] | None,
    sketch: Path | None = None,
    output: Path | None = None,
) -> Goals:
    """Return the goals for `--target`, `--stage` and `--sketch`.

    The target of a drawing is the file `OUTPUT.target.glb`, which is still to be made; without an output, the drawing
    itself is a file of the job.

    Raises
    ------
    typer.BadParameter
        They contradict each other, or a file of a stage does not exist.
    """
    given = {"--target": target, "--stage": stages or None, "--sketch": sketch}
    used = [name for name, value in given.items() if value is not None]
    if len(used) > 1:
        raise typer.BadParameter(f"{used[0]} and {used[1]} exclude each other", param_hint=used[1])
    if stages:
        return _staged(stages)
    if sketch is not None:
        drawn = {"sketch": sketch} if output is None else {"target": output.with_suffix(".target.glb")}
        return Goals({"guidance": "target"}, drawn)
    return Goals({"guidance": "target"}, {"target": target}) if target is not None else Goals()


def _staged(texts: Sequence[str]) -> Goals:
    """Return stages of prompts and of files, which are told from prompts by their endings."""
    stages: list[dict[str, str]] = []
    files: dict[str, Path] = {}
    for text in texts:
        path = Path(text)
        if path.suffix.lower() not in _MESHES:
            stages.append({"prompt": text})
            continue
        if not path.is_file():
            raise typer.BadParameter(f"there is no file {text}", param_hint="--stage")
        part = next((part for part, known in files.items() if known == path), None)
        if part is None:
            part = f"target_{len(files) + 1}" if files else "target"
            files[part] = path
        stages.append({"target": part, "name": path.stem})
    return Goals({"stages": stages}, files)


def stage_words(stage: Mapping[str, Any] | None, phase: str) -> str:
    """Return the phase of a job: while it optimises, its stage if it has one."""
    if not stage or phase != "optimizing":
        return phase
    return f"{stage['number']}/{stage['count']} {stage['name']}"
