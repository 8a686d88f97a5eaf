"""Draw the pictures that lessons rehearse: `python -m training.prior.rehearsal`.

Of each noun two members as the training draws them, and a plain one that measures what a lesson forgets; of each member
grids of four views and one single view. The same code draws the same pictures, and the file is written whole.
"""

from __future__ import annotations

import argparse
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from meshdeform.nouns.families import member
from meshdeform.priors.builtin.grammar import ParsedPrompt, tokenise
from meshdeform.priors.builtin.network import IMAGE_SIZE
from meshdeform.priors.builtin.teaching.pictures import LABELS, REHEARSAL
from meshdeform.priors.builtin.teaching.views import PictureSet, joined, pictures, single_views
from meshdeform.priors.builtin.vocabulary import NOUNS
from meshdeform.support.files import write_files
from training.prior.dataset import draw_prompt

__all__ = ["main", "rehearsal"]

_MEMBERS, _GRIDS, _HELD_GRIDS = 2, 2, 1
_TRAINING_SEED, _HELD_SEED = 0, 7


def rehearsal(nouns: list[str]) -> bytes:
    """Return the file of the pictures of some nouns."""
    pictures = {}
    for number, noun in enumerate(nouns):
        seeds = [(_TRAINING_SEED, number, k) for k in range(_MEMBERS)]
        sets = [_drawn(noun, seed, _GRIDS, plain=False) for seed in seeds]
        sets.append(_drawn(noun, (_HELD_SEED, number), _HELD_GRIDS, plain=True))
        prompts = [str(prompt) for some, prompt in sets for _ in range(len(some))]
        held_out = [some is sets[-1][0] for some, _ in sets for _ in range(len(some))]
        pictures[noun] = joined([some for some, _ in sets]), prompts, held_out
    return _packed(pictures)


def _packed(nouns: Mapping[str, tuple[PictureSet, Sequence[str], Sequence[bool]]]) -> bytes:
    """Return the file of `shipped_pictures` from each noun's pictures with their prompts and which are held out."""
    content = io.BytesIO()
    labels: dict[str, list[dict[str, object]]] = {}
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        for noun, (pictures, prompts, held_out) in nouns.items():
            column = pictures.images.permute(0, 2, 3, 1).reshape(-1, IMAGE_SIZE, 3).numpy()
            picture = io.BytesIO()
            Image.fromarray(column).save(picture, "WEBP", lossless=True, quality=100, method=6)
            archive.writestr(zipfile.ZipInfo(f"{noun}.webp"), picture.getvalue())
            rows = zip(prompts, pictures.azimuth_deg.tolist(), pictures.single.tolist(), held_out, strict=True)
            labels[noun] = [
                {"prompt": prompt, "azimuth_deg": azimuth, "single": single, "held": out}
                for prompt, azimuth, single, out in rows
            ]
        archive.writestr(zipfile.ZipInfo(LABELS), json.dumps(labels))
    return content.getvalue()


def _drawn(noun: str, seed: tuple[int, ...], grids: int, *, plain: bool) -> tuple[PictureSet, ParsedPrompt]:
    """Render grids and one single view of a member."""
    rng = np.random.default_rng(seed)
    prompt = ParsedPrompt(noun) if plain else draw_prompt(noun, rng)
    part = member(noun, prompt.attributes, rng)
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    several, azimuths = pictures(part, grids, generator)
    alone, azimuth = single_views(part, 1, generator)
    return PictureSet(
        torch.cat([several, alone]),
        torch.tensor([tokenise(prompt)] * (grids + 1)),
        torch.cat([azimuths, azimuth]),
        torch.arange(grids + 1) >= grids,
    ), prompt


def main() -> None:
    """Write the file."""
    description = (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m training.prior.rehearsal", description=description)
    parser.add_argument("-o", "--output", type=Path, default=REHEARSAL, help="default: in the package")
    write_files({parser.parse_args().output: rehearsal(list(NOUNS))})


if __name__ == "__main__":
    main()
