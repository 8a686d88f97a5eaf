"""Draw some assets with the names of their parts, for the documents: ``python -m bench.parts.picture FOLDER OUT.webp``.

Of the assets that may be published, those are drawn that are named here. They are read as they are, nothing given.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image, ImageChops, ImageDraw, ImageFont, ImageOps

from bench.parts.assets import Listed, files, listed
from bench.parts.find import found
from bench.parts.sheets import PAINTS, painted, shaded

_DRAWN = (
    "a_elephant", "k_husky", "spot", "a_bear",
    "k_suit", "p_lumberjack", "k_robotexpressive", "a_duck",
    "k_vehicle-truck-red", "n_helicopter", "k_house", "f_chair",
)  # fmt: skip
_COLUMNS, _WIDTH, _HEIGHT, _LINE, _LETTERS, _LINES = 4, 300, 250, 22, 17, 3
_AZIMUTH_DEG, _FINE, _SWATCH, _GAP = 35.0, 600, 14, 10
_QUALITY = 88


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description="Draw assets with the names of their parts.")
    parser.add_argument("folder", type=Path, help="where the files are")
    parser.add_argument("out", type=Path)
    parser.add_argument("--given", action="store_true", help="noun and front are given")
    asked = parser.parse_args()
    here, every = files(asked.folder), {each.name: each for each in listed(names=_DRAWN) if each.public}
    tiles = [_tile(every[name], here[every[name].sha256], given=asked.given) for name in _DRAWN]
    rows = -(-len(tiles) // _COLUMNS)
    whole = Image.new("RGB", (_COLUMNS * tiles[0].width, rows * tiles[0].height), "white")
    for number, tile in enumerate(tiles):
        whole.paste(tile, (number % _COLUMNS * tile.width, number // _COLUMNS * tile.height))
    whole.save(asked.out, quality=_QUALITY, method=6)


def _tile(each: Listed, path: Path, *, given: bool) -> Image.Image:
    """Return an asset in the colours of its parts, what it is read as above and their names below."""
    what = found(each, path, given=given)
    verts, faces = what.body.points @ each.turn.T, what.body.faces
    image = Image.new("RGB", (_WIDTH, _HEIGHT + (1 + _LINES) * _LINE + _GAP), "white")
    shown = _trimmed(shaded(verts, faces, painted(len(faces), what.parts), _AZIMUTH_DEG, _FINE))
    image.paste(shown, ((_WIDTH - shown.width) // 2, _LINE + (_HEIGHT - shown.height) // 2))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(_LETTERS)
    draw.text((_WIDTH / 2, 2), what.reading.noun, "black", font, anchor="mt")
    names = [name for name in what.parts if name != "body"]
    for number, (name, (x, y)) in enumerate(zip(names, _places(names, font), strict=False)):
        draw.rectangle((x, y + 4, x + _SWATCH, y + 4 + _SWATCH), PAINTS[number % len(PAINTS)])
        draw.text((x + _SWATCH + 4, y), name, "black", font)
    return image


def _trimmed(image: Image.Image) -> Image.Image:
    """Return what is not white of a picture, as large as fits."""
    inside = ImageChops.difference(image, Image.new("RGB", image.size, "white")).getbbox()
    return ImageOps.contain(image.crop(inside), (_WIDTH - 2 * _GAP, _HEIGHT - 2 * _GAP))


def _places(names: list[str], font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> list[tuple[float, float]]:
    """Return where names stand, line after line; those that no line is left for have no place."""
    places: list[tuple[float, float]] = []
    x, line = float(_GAP), 0
    for name in names:
        width = _SWATCH + 4 + font.getlength(name)
        if x > _GAP and x + width > _WIDTH:
            x, line = float(_GAP), line + 1
        if line == _LINES:
            break
        places.append((x, _HEIGHT + (1 + line) * _LINE))
        x += width + _GAP
    return places


if __name__ == "__main__":
    main()
