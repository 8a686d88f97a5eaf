"""Make readable file names. Standard library only."""

from __future__ import annotations

import re

__all__ = ["artifact_name", "result_name", "slug"]

_MAX_LENGTH = 48


def slug(text: str) -> str:
    """Return text as part of a file name: words joined by hyphens, at most 48 characters; empty if there is no word."""
    return re.sub(r"\W+", "-", text).strip("-_")[:_MAX_LENGTH].strip("-_")


def artifact_name(artifact: str, base: str) -> str:
    """Return the file name for an artifact: `BASE.glb` for `result.glb`, `BASE.preview.png` for `preview.png`."""
    return f"{base}{artifact.removeprefix('result')}" if artifact.startswith("result.") else f"{base}.{artifact}"


def result_name(artifact: str, *, source: str, goal: str, seed: int | None) -> str:
    """Return the file name for an artifact: `duck-a-tall-vase-seed7.glb` for `result.glb`.

    Parameters
    ----------
    artifact : str
        `result.glb` loses its stem; any other keeps it: `duck-a-tall-vase-seed7.preview.png`.
    source : str
        Name of the file that the job deforms; may be empty.
    goal : str
        The prompt, or what stands for it.
    seed : int, optional
    """
    # Not `Path.stem`: the name is a client's, of any platform.
    filename = re.split(r"[\\/]", source)[-1]
    stem = filename.rpartition(".")[0] or filename
    parts = [slug(stem), slug(goal), "" if seed is None else f"seed{seed}"]
    base = "-".join(filter(None, parts))
    return artifact_name(artifact, base) if base else artifact
