"""Measure how well drawings become shapes, beside the nearest neighbour by HOG features in the training set.

    python bench/sketch.py [--training 1200] [--other 72] [--sheet other.png]

Members that training held out, drawn by its own code, and members of other seeds drawn by the code below, which works
on pixels: edges of a picture of depth and normals, warped, grainy and rubbed out in places. `unsure` is the share of
them that is called so; drawings of other things ought to be: two of each noun of the builtin model that is unlike all
families, drawn by the training's code.
"""

from __future__ import annotations

import argparse
import io
import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from bench.parametric_families import family as members_of
from meshdeform.assets import load_asset
from meshdeform.assets.drawing import prepared, read_drawing
from meshdeform.errors import DrawingError
from meshdeform.kinds.sketch.choosing import gradients, line_pictures
from meshdeform.kinds.sketch.families import FAMILIES
from meshdeform.kinds.sketch.looking import SURE, WEIGHTS, look, read_weights
from meshdeform.kinds.sketch.solids import Solid
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.rasterizer import rasterize
from training.prior.families import FAMILIES as NOUNS
from training.prior.families import member as noun_member
from training.sketch.habits import random_view
from training.sketch.lines import View, joined, visible_lines
from training.sketch.network import SketchNetwork, load_network
from training.sketch.strokes import draw
from training.sketch.train import Drawings, make_drawings, measured

Floats = NDArray[np.float64]
_ALIKE = {"armchair", "bed", "bench", "cabinet", "desk", "sofa", "stool"}
"""Nouns whose drawings may rightly be taken for a chair or a table."""


def among(name: str, count: int = 32) -> None:
    """Print how often a drawing finds its member of a parametric family, and its sub-class, two drawings of each."""
    members = members_of(name, count)
    looks = np.stack([gradients(line_pictures(load_asset(each.glb(), each.name))) for each in members])
    ranks, kinds = [], []
    for number, seed in np.ndindex(count, 2):
        random = np.random.default_rng([number, seed])
        mesh = joined({name: solid for name, (_, solid) in members[number].solids.items()})
        drawn = prepared(draw(visible_lines(mesh, random_view(random)), random))
        order = np.linalg.norm(looks - gradients(drawn[None])[0], axis=2).min(1).argsort()
        ranks.append(int(np.flatnonzero(order == number)[0]))
        kinds.append(members[order[0]].kind == members[number].kind)
    first, three = np.mean(np.array(ranks) < 1), np.mean(np.array(ranks) < 3)
    print(f"{name}: first {first:.1%}  first three {three:.1%}  sub-class {np.mean(kinds):.1%}", flush=True)


def hog(pictures: NDArray[np.uint8], cell: int = 8, bins: int = 9) -> Floats:
    """Histograms of oriented gradients (N, D): unsigned, blocks of 2 x 2 cells of unit length (Dalal, Triggs 2005)."""
    values = pictures.astype(np.float64) / 255
    dy, dx = np.gradient(values, axis=(1, 2))
    size, place = np.hypot(dx, dy), np.mod(np.arctan2(dy, dx), np.pi) / np.pi * bins
    low = np.floor(place).astype(int) % bins
    share = place - np.floor(place)
    count, side = len(pictures), pictures.shape[1] // cell
    cells = np.zeros((count, side, side, bins))
    for number in range(bins):
        part = size * ((low == number) * (1 - share) + ((low + 1) % bins == number) * share)
        cells[..., number] = part.reshape(count, side, cell, side, cell).sum((2, 4))
    blocks = np.concatenate([cells[:, i : side - 1 + i, j : side - 1 + j] for i in (0, 1) for j in (0, 1)], -1)
    blocks /= np.linalg.norm(blocks, axis=-1, keepdims=True) + 1e-3
    return blocks.reshape(count, -1)


def pixel_drawing(mesh: Solid, view: View, random: np.random.Generator, size: int = 256) -> bytes:
    """Draw a mesh as a PNG by edges of its depth and normals, as a soft pencil on grey paper might."""
    low, high = mesh.verts.min(0), mesh.verts.max(0)
    verts = mesh.verts - (low + high) / 2
    radius = float(np.linalg.norm(verts, axis=1).max())
    cameras = fixed_cameras((view.azimuth_deg,), view.elevation_deg, view.fov_deg, fitting_radius=radius)
    clip = torch.from_numpy(np.c_[verts, np.ones(len(verts))]).float() @ cameras.view_proj[0].T
    seen = rasterize(clip[None], torch.from_numpy(mesh.faces), size, size)
    face, depth = seen.face_ids[0].numpy(), seen.depth[0].numpy()
    corners = verts[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    normal = np.where(face[..., None] >= 0, normals[face], 0)
    ink = np.zeros((size, size), bool)
    for axis in (0, 1):
        a, b = np.roll(face, 1, axis) >= 0, face >= 0
        jump = np.abs(np.roll(depth, 1, axis) - depth) > 0.04
        bend = (np.roll(normal, 1, axis) * normal).sum(-1) < 0.6
        ink |= (a != b) | (a & b & (jump | bend))
    smooth = Image.fromarray(random.normal(0, 1, (8, 16)).astype(np.float32)).resize((size, 2 * size), 3)
    shift = np.asarray(smooth) * random.uniform(0.5, 3.5)
    y, x = np.mgrid[:size, :size]
    ink = ink[np.clip(y + shift[:size], 0, size - 1).astype(int), np.clip(x + shift[size:], 0, size - 1).astype(int)]
    for _ in range(random.integers(0, 6)):
        at, reach = random.integers(0, size, 2), random.integers(4, 14)
        ink &= (y - at[0]) ** 2 + (x - at[1]) ** 2 > reach**2
    width = int(random.choice([1, 3, 5]))
    wide = Image.fromarray(ink.astype(np.uint8) * 255).filter(ImageFilter.MaxFilter(width))
    soft = np.asarray(wide.filter(ImageFilter.GaussianBlur(0.7)), np.float64) / 255
    grain = random.uniform(0.45, 1.0, (size, size))
    paper = random.uniform(0.85, 1.0)
    page = np.clip(paper - soft * grain + random.normal(0, 0.008, (size, size)), 0, 1)
    buffer = io.BytesIO()
    Image.fromarray((page * 255).astype(np.uint8)).save(buffer, "PNG")
    return buffer.getvalue()


def other_drawings(count: int, seed: int = 977) -> tuple[Drawings, int, list[bytes]]:
    """Return drawings by `pixel_drawing`, how many of them were refused, and the pictures."""
    names = list(FAMILIES)
    rows, files, refused = [], [], 0
    for number in range(count):
        random = np.random.default_rng([seed, number])
        family = FAMILIES[names[number % len(names)]]
        values = family.draw(random)
        data = pixel_drawing(joined(family.solids(values)), random_view(random), random)
        files.append(data)
        try:
            picture = read_drawing(data)
        except DrawingError as error:
            print(f"refused: {family.name} {number}: {error}")
            refused += 1
            continue
        numbers, choices = np.zeros(6, np.float32), np.zeros(3, np.int64)
        numbers[: len(family.numbers)] = family.shares(values)
        choices[: len(family.choices)] = family.indices(values)
        rows.append((np.round(picture * 255).astype(np.uint8), number % len(names), numbers, choices))
    return Drawings(*(np.stack(column) for column in zip(*rows, strict=True))), refused, files


def of_other_things() -> Drawings:
    """Return two drawings of each noun that is unlike the families; their numbers and choices mean nothing."""
    made = []
    for number, noun in enumerate(sorted(set(NOUNS) - set(FAMILIES) - _ALIKE)):
        for each in range(2):
            random = np.random.default_rng([7, number, each])
            part = noun_member(noun, (), random)
            mesh = joined({noun: Solid(np.asarray(part.verts, np.float64), np.asarray(part.faces))})
            made.append(np.round(prepared(draw(visible_lines(mesh, random_view(random)), random)) * 255))
    count = len(made)
    empty = np.zeros((count, 6), np.float32), np.zeros((count, 3), np.int64)
    return Drawings(np.stack(made).astype(np.uint8), np.zeros(count, np.int64), *empty)


def unsure(network: SketchNetwork, drawings: Drawings) -> float:
    """Return the share of drawings whose first guess is unsure."""
    with torch.no_grad():
        look = network(torch.from_numpy(drawings.pictures)[:, None].float() / 255)
    return float((look.family.softmax(1).amax(1) < SURE).float().mean())


def nearest(train: Drawings, test: Drawings) -> dict[str, float]:
    """Return what `measured` does for the nearest neighbour by HOG; numbers and choices within the true family."""
    a, b = hog(train.pictures), hog(test.pictures)
    distance = (b**2).sum(1)[:, None] + (a**2).sum(1)[None] - 2 * b @ a.T
    order = distance.argsort(1)
    right, errors, choices, three = [], [], [], []
    for row, family in enumerate(test.family):
        about = list(FAMILIES.values())[family]
        ranked = list(dict.fromkeys(train.family[order[row]].tolist()))
        right.append(ranked[0] == family)
        three.append(family in ranked[:3])
        best = order[row][train.family[order[row]] == family][0]
        n = len(about.numbers)
        errors += np.abs(train.numbers[best, :n] - test.numbers[row, :n]).tolist()
        choices += (train.choices[best] == test.choices[row])[: len(about.choices)].tolist()
    return {"top_1": float(np.mean(right)), "top_3": float(np.mean(three)), "number_error": float(np.mean(errors)),
            "choices": float(np.mean(choices))}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--training", type=int, default=1200, help="the number of drawings of the training")
    parser.add_argument("--among", action="store_true", help="only measure how drawings find members of families")
    parser.add_argument("--cache", type=Path, help="the training's drawings, if it kept them")
    parser.add_argument("--other", type=int, default=72)
    parser.add_argument("--sheet", type=Path, help="draw the drawings of the second set")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.among:
        for name in ("chairs", "airplanes"):
            among(name)
        return
    network = load_network()
    if options.cache:
        with np.load(options.cache) as kept:
            drawings = Drawings(*(kept[name] for name in ("pictures", "family", "numbers", "choices")))
    else:
        drawings = make_drawings(options.training, 0)
    held = max(len(drawings.family) // 10, 1)
    train, held_out = drawings.part(slice(held, None)), drawings.part(slice(held))
    other, refused, files = other_drawings(options.other)
    middle = np.full(train.numbers.shape[1], 0.5)
    sets = {
        "held out": held_out,
        "other strokes": other,
    }
    for title, test in sets.items():
        print(f"{title}: {len(test.family)} drawings")
        results = {"network": measured(network, test)}
        if test is held_out or test is other:
            results["HOG"] = nearest(train, test)
        for name, found in results.items():
            print(f"  {name:8}", "  ".join(f"{key} {value:.3f}" for key, value in found.items()))
        guess = [np.abs(middle - row)[: len(list(FAMILIES.values())[f].numbers)] for row, f in
                 zip(test.numbers, test.family, strict=True)]  # fmt: skip
        print(f"  middle   number_error {np.concatenate(guess).mean():.3f}")
        print(f"  unsure   {unsure(network, test):.3f}")
    print(f"refused of the second set: {refused} of {options.other}")
    things = of_other_things()
    print(f"other things: {len(things.family)} drawings, unsure {unsure(network, things):.3f}")
    picture, weights = other.pictures[0].astype(np.float32) / 255, read_weights()
    look(picture, weights)
    start = time.process_time()
    for _ in range(20):
        look(picture, weights)
    print(f"a look: {(time.process_time() - start) / 20 * 1e3:.2f} ms of CPU; weights {WEIGHTS.stat().st_size} bytes")
    if options.sheet:
        sheet = Image.new("L", (12 * 128, -(-len(files) // 12) * 128), 255)
        for number, data in enumerate(files):
            small = Image.open(io.BytesIO(data)).resize((124, 124))
            sheet.paste(small, (number % 12 * 128, number // 12 * 128))
        sheet.save(options.sheet)


if __name__ == "__main__":
    main()
