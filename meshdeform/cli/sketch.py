"""`meshdeform sketch`: make meshes of a line drawing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.local import check_free, check_glb, write_all
from meshdeform.cli.options import ForceOption, JsonOption, file_argument, flag, option, output_option
from meshdeform.cli.output import emit
from meshdeform.cli.request import split_pairs
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.kinds.sketch.looking import Guess


@clean_errors
def sketch(
    drawing: Annotated[
        Path | None, file_argument("The PNG, JPEG or WebP. Without it, --family and --set alone make a mesh.")
    ] = None,
    output: Annotated[Path | None, output_option("The GLB of the first guess. Default: DRAWING.glb here.")] = None,
    family: Annotated[str, option("Family of the drawing, such as chair: no other is considered.")] = "",
    change: Annotated[
        list[str] | None, flag("--set", "A parameter of the first guess as NAME=VALUE; may be repeated.")
    ] = None,
    among: Annotated[
        Path | None,
        typer.Option(
            help="Choose among these assets instead: a folder or a ZIP, such as a family's shapes.", exists=True
        ),
    ] = None,
    parameters: Annotated[bool, flag("--parameters", "List the families with their parameters, and end.")] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Guess what DRAWING shows, and write the first three guesses as meshes and as one picture.

    meshdeform sketch chair.png -o chair.glb --set legs=column
    """
    require("scipy", "deform")
    from meshdeform.kinds.sketch.families import FAMILIES
    from meshdeform.kinds.sketch.looking import is_unsure

    if parameters:
        _list(as_json=as_json)
        return
    if among is not None:
        if drawing is None:
            raise ParameterError("There is no drawing to choose by.", advice="Name a picture.")
        _choose(drawing, among, output or Path(f"{drawing.stem}.glb"), force=force, as_json=as_json)
        return
    answers = _guesses(drawing, family, {name: text.strip() for name, text in split_pairs(change or [], "--set")})
    output = output or Path(f"{drawing.stem if drawing else family}.glb")
    check_glb(output)
    paths = [output, *(output.with_suffix(f".{number}.glb") for number in range(2, len(answers) + 1))]
    picture = output.with_suffix(".png")
    if drawing is not None and picture.exists() and picture.samefile(drawing):
        picture = output.with_suffix(".guesses.png")
    check_free([*paths, picture], [drawing], force=force)
    _write(answers, paths, picture)
    unsure = is_unsure(answers, family=family)
    if as_json:
        guesses = [
            {"family": each.family, "probability": each.probability, "parameters": each.values, "file": str(path)}
            for each, path in zip(answers, paths, strict=True)
        ]
        emit({"guesses": guesses, "unsure": unsure, "picture": str(picture)})
        return
    for each, path in zip(answers, paths, strict=True):
        typer.echo(f"{path}: {_words(each)}")
    typer.echo(f"{picture}: all of them")
    if unsure:
        typer.echo(
            f"The first guess is unsure: this may be none of {', '.join(FAMILIES)}. "
            "If it is one of them, name it with --family.",
            err=True,
        )


def _choose(drawing: Path, among: Path, output: Path, *, force: bool, as_json: bool) -> None:
    """Write the three assets of a folder or a ZIP that look most like a drawing."""
    from meshdeform.assets import Limits, load_asset
    from meshdeform.assets.collection import LABELS_FILE, unpacked
    from meshdeform.client.orders import files_in
    from meshdeform.kinds.sketch.choosing import distances

    if among.is_dir():
        files = {name: path.read_bytes() for name, path in files_in([among]).items()}
    else:
        files = unpacked(among.read_bytes(), Limits())
    files.pop(LABELS_FILE, None)
    apart = distances(drawing.read_bytes(), (load_asset(data, name) for name, data in files.items()))
    nearest = [list(files)[place] for place in apart.argsort()[:3]]
    starts = ("", ".2", ".3")
    chosen = {output.with_suffix(start + Path(name).suffix): name for start, name in zip(starts, nearest, strict=False)}
    check_free(list(chosen), [drawing], force=force)
    write_all({path: files[name] for path, name in chosen.items()}, what="The assets")
    if as_json:
        emit({"chosen": [{"name": name, "file": str(path)} for path, name in chosen.items()]})
        return
    for path, name in chosen.items():
        typer.echo(f"{path}: {name}")


def _guesses(drawing: Path | None, family: str, changes: dict[str, str]) -> list[Guess]:
    """Return the guesses of a drawing, the first one with the changes; without a drawing, a member of the family."""
    from meshdeform.kinds.sketch.looking import Guess, guess

    if drawing is None:
        if not family:
            raise ParameterError(
                "There is neither a drawing nor a family.", advice="Name a picture, or a family with --family."
            )
        return [Guess.of(family, 1.0, changes)]
    first, *others = guess(drawing.read_bytes(), family=family)
    return [Guess.of(first.family, first.probability, {**first.values, **changes}), *others]


def _write(guesses: Sequence[Guess], paths: Sequence[Path], picture: Path) -> None:
    """Write the meshes and the picture of them, all or none."""
    from meshdeform.assets import Limits, load_asset
    from meshdeform.runs.family_pictures import assets_png

    files = {path: each.glb() for each, path in zip(guesses, paths, strict=True)}
    assets = [load_asset(data, "shape.glb", Limits.unlimited()) for data in files.values()]
    titles = [f"{each.family} {each.probability:.0%}" for each in guesses]
    files[picture] = assets_png(assets, titles)
    write_all(files, what="The meshes")


def _words(guess: Guess) -> str:
    values = ", ".join(f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
                       for name, value in guess.values.items())  # fmt: skip
    return f"{guess.family} ({guess.probability:.0%}): {values}"


def _list(*, as_json: bool) -> None:
    """Print the families with their parameters, ranges and defaults."""
    from meshdeform.kinds.sketch.families import FAMILIES

    if as_json:
        known: dict[str, Any] = {
            family.name: {
                **{n.name: {"minimum": n.low, "maximum": n.high, "default": n.default} for n in family.numbers},
                **{c.name: {"options": list(c.options), "default": c.default} for c in family.choices},
            }
            for family in FAMILIES.values()
        }
        emit({"families": known})
        return
    for family in FAMILIES.values():
        typer.echo(family.name)
        for number in family.numbers:
            typer.echo(f"  {number.name:<16} {number.low:g} to {number.high:g}, default {number.default:g}")
        for choice in family.choices:
            typer.echo(f"  {choice.name:<16} {', '.join(choice.options)}; default {choice.default}")
