"""Write the page of all nouns, with a picture of each: ``python -m bench.noun_page``.

It writes `docs/nouns.md` and a sheet for each group of nouns below `docs/pictures/nouns`. A tile shows a member of the
noun's family; those of living nouns look to the left.
"""

from __future__ import annotations

from pathlib import Path

from PIL import Image, ImageDraw

from bench.label_sheets import picture, sheet
from meshdeform.nouns.families import KINDS
from meshdeform.reading.banks import candidate_member
from meshdeform.vocabulary.nouns import NOUN_GROUPS, TABLE, Noun

_DOCS = Path(__file__).parents[1] / "docs"
_TILE, _LINE, _COLUMNS = 96, 14, 10
_HEAD = """# Nouns

{count} nouns have shapes. A prompt names one, by its name or another: `a tall {example}`. Every noun takes every
adjective ([prompts](exemplar.md)); *parts* are those whose size a prompt can set, such as `long legs`; *kinds* are what
its shapes may be besides. German and Spanish words are understood as well. [Words of your own](words.md) stand beside
these.
"""


def tile(noun: str) -> Image.Image:
    """Return a picture of a member, with its noun above."""
    member = candidate_member(noun, 0, ())
    views = picture(member.verts, member.faces, [""] * len(member.faces), room=1.0)
    image = Image.new("RGB", (_TILE, _TILE + _LINE), "white")
    half = views.crop((0, 0, views.height, views.height - 12))  # without the name of its one part
    image.paste(half.resize((_TILE, _TILE), Image.Resampling.LANCZOS), (0, _LINE))
    ImageDraw.Draw(image).text((2, 1), noun, "black")
    return image


def row(noun: Noun) -> str:
    """Return the line of a noun in its group's table."""
    kinds = ", ".join(kind.replace("-", " ") for kind in KINDS.get(noun.name, ()))
    return f"| {noun.name} | {', '.join(noun.synonyms)} | {', '.join(noun.parts)} | {kinds} |"


def main() -> None:
    """Write the page and its pictures."""
    folder = _DOCS / "pictures" / "nouns"
    folder.mkdir(parents=True, exist_ok=True)
    lines = [_HEAD.format(count=len(TABLE), example="giraffe")]
    for group, nouns in NOUN_GROUPS.items():
        name = f"{group.replace(' ', '-')}.png"
        sheet([tile(noun) for noun in nouns], _COLUMNS).quantize(48, dither=Image.Dither.NONE).save(
            folder / name, optimize=True
        )
        lines += [f"## {group.capitalize()}", "", f"![{group}](pictures/nouns/{name})", ""]
        lines += [
            "| noun | other names | parts | kinds |",
            "|---|---|---|---|",
            *(row(TABLE[noun]) for noun in nouns),
            "",
        ]
    (_DOCS / "nouns.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
