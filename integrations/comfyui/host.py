"""The parts of ComfyUI that the nodes need: its folders, its progress bar, its Cancel button, its images.

ComfyUI's modules and torch are imported when a node runs, never when the nodes are loaded.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .jobs import NodeError

__all__ = ["Output", "assets", "check_interrupted", "digest", "find", "image", "output", "progress_bar"]

EXTENSIONS = (".glb", ".obj", ".ply", ".stl", ".zip")
_TICKS = 1000


@dataclass(frozen=True)
class Output:
    """Names for the files of one result in ComfyUI's output folder, which exist nowhere yet."""

    folder: Path
    stem: str
    subfolder: str

    def path(self, suffix: str) -> Path:
        """Return the path with a suffix, such as `.glb`."""
        return self.folder / f"{self.stem}{suffix}"

    def relative(self, suffix: str) -> str:
        """Return the path within the output folder, as Preview 3D takes it."""
        return "/".join(part for part in (self.subfolder.replace(os.sep, "/"), f"{self.stem}{suffix}") if part)


def assets() -> list[str]:
    """Return the assets below ComfyUI's input folder, as paths within it."""
    import folder_paths

    top = Path(folder_paths.get_input_directory())
    names = [
        (Path(folder) / name).relative_to(top).as_posix()
        for folder, _, files in os.walk(top, followlinks=True)
        for name in files
    ]
    return sorted(name for name in names if name.lower().endswith(EXTENSIONS))


def find(name: str) -> Path:
    """Return the file that a name stands for.

    Parameters
    ----------
    name : str
        A path within the input folder, one that ends with ` [output]`, ` [input]` or ` [temp]`, as ComfyUI writes
        them, or a full path below one of these folders.
    """
    import folder_paths

    if not name.strip():
        raise NodeError("There is no asset. Connect Load 3D Asset, or another node that gives a path.")
    path = Path(os.path.abspath(folder_paths.get_annotated_filepath(name)))  # noqa: PTH100 - links are the user's
    tops = (
        folder_paths.get_input_directory(),
        folder_paths.get_output_directory(),
        folder_paths.get_temp_directory(),
    )
    if not any(path.is_relative_to(os.path.abspath(top)) for top in tops):  # noqa: PTH100
        raise NodeError(f"{name} is outside of ComfyUI's input, output and temp folders. Copy it into one of them.")
    if not path.is_file():
        raise NodeError(f"There is no file {name}. A result in the output folder is named by glb_path.")
    return path


def digest(name: str) -> str:
    """Return the SHA-256 of a file, by which ComfyUI sees that it has changed."""
    with find(name).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def output(prefix: str) -> Output:
    """Return new names in the output folder, numbered as ComfyUI does it."""
    import folder_paths

    folder, name, number, subfolder, _ = folder_paths.get_save_image_path(prefix, folder_paths.get_output_directory())
    return Output(Path(folder), f"{name}_{number:05}_", subfolder)


def progress_bar() -> Callable[[float], None]:
    """Return a function that shows a fraction, from 0 to 1, on the node that runs."""
    from comfy.utils import ProgressBar

    bar = ProgressBar(_TICKS)
    return lambda fraction: bar.update_absolute(round(fraction * _TICKS), _TICKS)


def check_interrupted() -> None:
    """Raise ComfyUI's own exception if somebody has pressed Cancel."""
    from comfy.model_management import throw_exception_if_processing_interrupted

    throw_exception_if_processing_interrupted()


def image(png: bytes) -> Any:
    """Return a picture as ComfyUI's IMAGE: a tensor of shape (1, height, width, 3), float32, from 0 to 1."""
    import numpy as np
    import torch
    from PIL import Image

    with Image.open(io.BytesIO(png)) as picture:
        pixels = np.asarray(picture.convert("RGB"), dtype=np.float32) / 255.0
    return torch.from_numpy(pixels)[None]
