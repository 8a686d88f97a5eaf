"""Fit the projection by which a drawing shows its noun.

    python -m training.sketch.train --people quickdraw/ --cache members.npz -o sketch.safetensors

It is fitted to three of four drawings of each ndjson file of a folder (Quick, Draw! by Google, CC-BY 4.0), warped a few
times, and to lines of members. `--hold-out` leaves every fourth word out, for docs/sketch.md's figure of nouns of which
no drawing was seen.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from safetensors.numpy import save_file
from scipy.linalg import cholesky, solve_triangular

from meshdeform.kinds.sketch.looking import gradients, inked
from meshdeform.vocabulary.nouns import NOUNS
from training.sketch.members import pictures_of
from training.sketch.people import People, read_people

_DIMENSIONS, _EVENNESS, _OF_MEMBERS = 200, 1.0, 0.3
"""Of the projection; share of the mean variance that is added to all, and weight of members' variance in it."""
_BEHIND = -0.12
"""Offset of places that are of members' lines alone, in cosines."""
_SCALE = 18.0
"""Of cosines in the logarithm of a likelihood: that at which the first guess is as often right as it says."""
_WARPS = 3

Singles = NDArray[np.float32]
Index = NDArray[np.int64]


def warped(pictures: Singles, rng: np.random.Generator) -> Singles:
    """Return pictures (N, S, S) as other hands would draw them: turned, slanted, stretched, mirrored."""
    found = np.empty_like(pictures)
    middle = np.full(2, pictures.shape[1] / 2)
    for each, into in zip(pictures, found, strict=True):
        turn, slant, mirror = rng.normal(0, 0.12), rng.normal(0, 0.1), rng.choice((-1, 1))
        wide, tall = np.exp(rng.normal(0, 0.12, 2))
        way = np.array([[wide * np.cos(turn), slant - np.sin(turn)], [np.sin(turn), tall * np.cos(turn)]])
        way[:, 0] *= mirror
        start = middle - way @ (middle + rng.normal(0, 1.5, 2))
        numbers = (*way[0], start[0], *way[1], start[1])
        picture = Image.fromarray(each).transform(
            each.shape, Image.Transform.AFFINE, numbers, Image.Resampling.BILINEAR
        )
        into[:] = np.asarray(picture)
    return found


def features(pictures: Singles) -> Singles:
    """Return the gradients (N, D) of pictures (N, S, S), few at a time."""
    return np.concatenate([gradients(pictures[k : k + 256]) for k in range(0, len(pictures), 256)])


def means(values: Singles, of: Index) -> tuple[Index, Singles]:
    """Return the classes (C,) that there are and the mean (C, D) of each, of values (N, D)."""
    classes, place = np.unique(of, return_inverse=True)
    total = np.zeros((len(classes), values.shape[1]), np.float64)
    np.add.at(total, place, values)
    return classes, (total / np.bincount(place)[:, None]).astype(np.float32)


def scatter(values: Singles, of: Index) -> Singles:
    """Return the covariance (D, D) of values within their classes."""
    classes, middles = means(values, of)
    apart = values - middles[np.searchsorted(classes, of)]
    return np.asarray(apart.T @ apart / len(values))


def fitted(people: Singles, whose: Index, members: Singles, of: Index) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of `looking.Projection`.

    `people` (N, D): gradients of drawings, `whose` (N,) their classes; `members` (M, D) and `of` (M,): of members.
    """
    classes, drawn = means(people, whose)
    nouns, lines = means(members, of)
    middle, other = people.mean(0), members.mean(0)
    within = scatter(people, whose) + _OF_MEMBERS * scatter(members, of)
    within += _EVENNESS * np.trace(within) / len(within) * np.eye(len(within), dtype=np.float32)
    root = cholesky(within, lower=True)
    white = solve_triangular(root, (drawn - middle).T, lower=True)
    axes = np.linalg.svd(white, full_matrices=False)[0][:, :_DIMENSIONS]
    projection = solve_triangular(root, axes, lower=True, trans=1)
    places = np.concatenate([(drawn - middle) @ projection, (lines - other) @ projection])
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    half = {"projection": projection, "people": middle, "members": other, "places": places}
    return {
        **{name: np.ascontiguousarray(each, np.float16) for name, each in half.items()},
        "of": np.concatenate([classes, nouns]).astype(np.int32),
        "offset": np.repeat([0.0, _BEHIND], [len(classes), len(nouns)]).astype(np.float32),
        "scale": np.array(_SCALE, np.float32),
    }


def members(cache: Path | None) -> tuple[Singles, Index]:
    """Return the gradients of the lines of members of all nouns (M, D), and the noun of each, kept in a file."""
    if cache is not None and cache.exists():
        with np.load(cache) as file:
            return file["features"].astype(np.float32), file["of"]
    found, of = [], []
    for number, noun in enumerate(sorted(NOUNS)):
        pages = np.stack([inked(page) for page in pictures_of(noun, 1)])
        found.append(features(pages))
        of += [number] * len(pages)
    every, classes = np.concatenate(found), np.array(of)
    if cache is not None:
        np.savez_compressed(cache, features=every.astype(np.float16), of=classes)
    return every, classes


def learnt(people: People) -> tuple[Singles, Index]:
    """Return the gradients of the drawings to learn from, warped a few times, and their classes."""
    rng = np.random.default_rng(0)
    pictures, classes = people.pictures[people.to_learn], people.classes[people.to_learn]
    some = [pictures, pictures[:, :, ::-1], *(warped(pictures, rng) for _ in range(_WARPS))]
    return np.concatenate([features(each) for each in some]), np.tile(classes, len(some))


def main() -> None:
    """Fit, and write the file of weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=Path, required=True, help="folder of ndjson files, one of each word")
    parser.add_argument("--cache", type=Path, help="file for the lines of members")
    parser.add_argument("--hold-out", action="store_true", help="learn nothing of every fourth word")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    arrays = fitted(*learnt(read_people(options.people, hold_out=options.hold_out)), *members(options.cache))
    save_file(arrays, options.output, {"nouns": " ".join(sorted(NOUNS))})


if __name__ == "__main__":
    main()
