"""Write down which files of collections show what: `python -m training.collections.scan FOLDER -o OUT`.

OUT gets `members.json` (path, noun, author, pack, who learns from it, azimuth of the front, what was left out and why)
and `shapes/`, the meshes as the training draws them. Files that show the same shape are counted once, and so are copies
of assets that results are measured on (`--leave-out`): shapes are compared, not names.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.bundle import read_with_files
from meshdeform.errors import AssetEmptyError, MeshdeformError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import simplified
from meshdeform.geometry.weld import weld
from meshdeform.nouns.deformed import Part, normalised
from meshdeform.nouns.families import FAMILIES, member
from meshdeform.priors.builtin.prior import STYLE
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer
from meshdeform.support.files import write_files
from training.collections.nouns import noun_of
from training.collections.sources import MARKET, PRIOR, collection_of, creator_of, pack_of, split_of
from training.prior.pictures import CAMERAS

_SUFFIXES = frozenset({".glb", ".gltf"})
_MIN_FACES, _MAX_FACES = 4, 20_000
"""Larger meshes are simplified: a view has 64 pixels."""
_SMALLEST_SHARE = 0.004
"""Least share of a view's pixels that a shape must cover, seen from the side where it shows least."""
_BINS, _PAIRS = 64, 200_000
_SAME_DISTANCES, _SAME_VIEWS = 0.025, 0.02
"""Copies differ at most by this share of their histograms of distances, and by this mean of their views."""
_TEMPLATES, _CLEARLY = 6, 0.75
_FEWEST_NOUNS, _LONG = 3, 1.7
_SEEDLINGS = "crops_pack"
"""The pack that has plants as they grow under the names of their fruit."""
_View = NDArray[np.float32]


@dataclass
class Found:
    """A file that shows a noun."""

    path: str
    noun: str
    author: str
    pack: str
    shape: str  # name of its mesh below `shapes/`
    split: str = PRIOR
    front_deg: int = 0


@dataclass(frozen=True)
class Drawn:
    """A shape, the histogram (64,) of distances between its points, and its views (4, S, S, 3)."""

    part: Part
    distances: NDArray[np.float64]
    views: _View

    @classmethod
    def of(cls, part: Part) -> Drawn:
        """Measure a shape."""
        return cls(part, distances(part), four_views(part))


Seen = tuple[Found, Drawn]


def candidates(folder: Path) -> Iterator[tuple[Found, Path]]:
    """Give the files of known collections whose names are nouns."""
    for path in sorted(folder.rglob("*")):
        inner = path.relative_to(folder).as_posix()
        collection, noun = collection_of(inner), noun_of(shown_name(path))
        if collection is None or noun is None or path.suffix.lower() not in _SUFFIXES or _SEEDLINGS in inner:
            continue
        if pack_of(inner) == MARKET and creator_of(path) != collection.author.lower():
            continue
        shape = hashlib.sha256(inner.encode()).hexdigest()[:16]
        yield Found(inner, noun, collection.author, pack_of(inner), shape), path


def shown_name(path: Path) -> str:
    """Return the name that says what a file shows; that of its folder if every file is called `model`."""
    return path.parent.name if path.stem == "model" else path.stem


def read_shape(path: Path) -> Part:
    """Read a file as the training draws it.

    Raises
    ------
    MeshdeformError
        It cannot be read, or nothing of it can be seen.
    """
    limits = Limits()
    surface = load_asset(read_with_files(path, limits), path.name, limits).surface
    return shape_of(weld(surface.positions, surface.triangles).mesh, path.name)


def shape_of(mesh: TriangleMesh, name: str) -> Part:
    """Prepare a welded mesh (+Y up): centred, its farthest vertex at distance 1.

    Parameters
    ----------
    mesh : TriangleMesh
        World space, any size; it may be open or have many parts.
    name : str
        That of its file.

    Raises
    ------
    AssetEmptyError
        It has fewer than 4 faces, or is so thin that it vanishes from some side.
    """
    if len(mesh.faces) < _MIN_FACES:
        raise AssetEmptyError(f"{name} has {len(mesh.faces)} faces with an area, fewer than {_MIN_FACES}.")
    if len(mesh.faces) > _MAX_FACES:
        mesh = simplified(mesh, _MAX_FACES)
    part = normalised(Part(mesh.verts, mesh.faces))
    shares = (four_views(part) > 0).any(-1).mean((1, 2))
    if shares.min() < _SMALLEST_SHARE:
        raise AssetEmptyError(
            f"{name} covers {shares.min():.2%} of a picture from its thinnest side: nearly nothing but background."
        )
    return part


def four_views(part: Part) -> _View:
    """Render four views a quarter turn apart (4, S, S, 3), of the middle elevation."""
    verts = torch.from_numpy(part.verts)
    renderer = Renderer(torch.from_numpy(part.faces), len(verts), STYLE)
    cameras = fixed_cameras(0.0, CAMERAS.elevation_max_deg / 2, CAMERAS.fov_min_deg)
    with torch.no_grad():
        views: _View = renderer.render(verts, cameras)[..., :3].numpy()
    return views


def distances(part: Part) -> NDArray[np.float64]:
    """Return the histogram (64,) of distances between random points of a surface, which no rotation or size changes."""
    rng = np.random.default_rng(0)
    corners = part.verts[part.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = rng.choice(len(areas), 2 * _PAIRS, p=areas / areas.sum())
    share = np.sqrt(rng.random(2 * _PAIRS)), rng.random(2 * _PAIRS)
    a, b, c = corners[faces].transpose(1, 0, 2)
    points = a + share[0][:, None] * ((b - a) + share[1][:, None] * (c - b))
    apart = np.linalg.norm(points[:_PAIRS] - points[_PAIRS:], axis=1)
    histogram, _ = np.histogram(apart / apart.mean(), _BINS, (0.0, 3.0))
    return np.asarray(histogram / _PAIRS)


def same(one: Drawn, other: Drawn) -> bool:
    """Return whether two shapes are copies, turned by quarter turns about the upright axis and scaled."""
    if np.abs(one.distances - other.distances).sum() / 2 > _SAME_DISTANCES:
        return False
    return min(float(np.abs(np.roll(one.views, -k, 0) - other.views).mean()) for k in range(4)) < _SAME_VIEWS


def turns(shown: _View, template: _View) -> tuple[int, NDArray[np.float64]]:
    """Return the quarter turn at which views (4, S, S, 3) resemble a template most, and the errors (4,) of each."""
    errors = np.array([np.square(np.roll(shown, -k, 0) - template).mean() for k in range(4)], dtype=np.float64)
    return int(errors.argmin()), errors


def _generated(noun: str) -> _View:
    """Return the mean of the views of a family's plain members."""
    members = [member(noun, (), np.random.default_rng([5, number])) for number in range(_TEMPLATES)]
    return np.asarray(np.mean([four_views(normalised(each)) for each in members], axis=0), dtype=np.float32)


def set_fronts(members: Sequence[Seen]) -> None:
    """Set the front of each file: its pack's habit, learnt from nouns with a family, or its own if clear."""
    templates = {noun: _generated(noun) for noun in {asset.noun for asset, _ in members} & set(FAMILIES)}
    votes = defaultdict[str, dict[str, Counter[int]]](lambda: defaultdict(Counter))
    clear = {}
    for asset, picture in members:
        if asset.noun in templates:
            turn, errors = turns(picture.views, templates[asset.noun])
            best, second = np.sort(errors)[:2]
            if best < _CLEARLY * second:
                clear[asset.path] = turn
                votes[asset.pack][asset.noun][turn] += 1
    for asset, _ in members:
        asset.front_deg = 90 * clear.get(asset.path, _habit(votes[asset.pack].values()))


def _habit(votes: Iterable[Counter[int]]) -> int:
    """Return the turn that most nouns of a pack agree on: each has one vote; 0, as glTF says, if they disagree."""
    agreed = Counter(turns.most_common(1)[0][0] for turns in votes)
    turn, count = max(agreed.items(), key=lambda entry: entry[1], default=(0, 0))
    return turn if count >= _FEWEST_NOUNS and 3 * count >= 2 * agreed.total() else 0


def align_groups(members: Sequence[Seen]) -> None:
    """Turn the members of a noun without a family alike, each pack as the others, where that is clear."""
    groups = defaultdict[str, defaultdict[str, list[Seen]]](lambda: defaultdict(list))
    for each in members:
        if each[0].noun not in FAMILIES:
            groups[each[0].noun][each[0].pack].append(each)
    for packs in groups.values():
        largest, *smaller = sorted(packs.values(), key=len, reverse=True)
        for own in smaller:
            turn, errors = turns(_mean_view(own), _mean_view(largest))
            for asset, _ in own if errors[turn] < _CLEARLY * errors[0] else []:
                asset.front_deg = (asset.front_deg + 90 * turn) % 360
            largest = [*largest, *own]


def _mean_view(members: Sequence[Seen]) -> _View:
    shown = [np.roll(picture.views, -asset.front_deg // 90, 0) for asset, picture in members]
    return np.asarray(np.mean(shown, axis=0), dtype=np.float32)


def standing_alike(members: Sequence[Seen]) -> list[Seen]:
    """Return the members without long ones that lie where most of their noun stand, or stand where most lie."""
    votes = defaultdict[str, Counter[bool]](Counter)
    stands = {asset.path: _stands(picture.part) for asset, picture in members}
    for asset, _ in members:
        if (standing := stands[asset.path]) is not None:
            votes[asset.noun][standing] += 1
    habit = {noun: stances.most_common(1)[0][0] for noun, stances in votes.items()}
    return [each for each in members if stands[each[0].path] in (None, habit.get(each[0].noun))]


def _stands(part: Part) -> bool | None:
    """Return whether a long shape stands; None if it is not long."""
    extent = np.ptp(part.verts, axis=0)
    _, second, longest = np.sort(extent)
    return bool(extent.argmax() == 1) if longest > _LONG * second else None


def unlike(members: Sequence[Seen], known: Sequence[Drawn]) -> list[Seen]:
    """Return the first of each shape of a noun, without those that are known from elsewhere."""
    distinct: list[Seen] = []
    for asset, picture in members:
        peers = [other for each, other in distinct if each.noun == asset.noun]
        if not any(same(picture, other) for other in (*peers, *known)):
            distinct.append((asset, picture))
    return distinct


def scan(folder: Path, output: Path, leave_out: Sequence[Path]) -> dict[str, Any]:
    """Scan a folder of collections; write and return the index."""
    (output / "shapes").mkdir(parents=True, exist_ok=True)
    members, refused = list[Seen](), dict[str, str]()
    for asset, path in candidates(folder):
        try:
            members.append((asset, Drawn.of(read_shape(path))))
        except MeshdeformError as error:
            refused[asset.path] = error.detail
    chosen = standing_alike(unlike(members, [Drawn.of(read_shape(path)) for path in leave_out]))
    set_fronts(chosen)
    align_groups(chosen)
    for noun in {asset.noun for asset, _ in chosen}:
        assets = [asset for asset, _ in chosen if asset.noun == noun]
        split = split_of([(asset.path, asset.author, asset.pack) for asset in assets])
        for asset in assets:
            asset.split = split[asset.path]
    for asset, picture in chosen:
        verts, faces = picture.part.verts.astype(np.float32), picture.part.faces.astype(np.int32)
        np.savez(output / "shapes" / f"{asset.shape}.npz", verts=verts, faces=faces, views=picture.views)
    paths = {asset.path for asset, _ in chosen}
    index = {
        "members": [asdict(asset) for asset, _ in chosen],
        "left_out": sorted(asset.path for asset, _ in members if asset.path not in paths),
        "refused": refused,
    }
    write_files({output / "members.json": (json.dumps(index, indent=1) + "\n").encode()})
    return index


def main() -> None:
    """Scan, and print the nouns with their members by who learns from them."""
    parser = argparse.ArgumentParser(prog="python -m training.collections.scan", description=main.__doc__)
    parser.add_argument("folder", type=Path, help="folder with the folders of all collections")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--leave-out", type=Path, nargs="*", default=[], help="assets that results are measured on")
    arguments = parser.parse_args()
    index = scan(arguments.folder, arguments.output, arguments.leave_out)
    print(counts(index["members"]))


def counts(members: Sequence[dict[str, str]]) -> str:
    """Return a table of nouns: members of the prior, of the judge, held out, authors and packs."""
    lines = ["noun | prior | judge | held out | authors | packs"]
    for noun in sorted({each["noun"] for each in members}):
        entries = [each for each in members if each["noun"] == noun]
        split = Counter(each["split"] for each in entries)
        row = [noun, split["prior"], split["judge"], split["held out"]]
        lines.append(
            " | ".join(map(str, [*row, len({e["author"] for e in entries}), len({e["pack"] for e in entries})]))
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
