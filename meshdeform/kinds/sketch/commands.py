"""The command `sketch`: make meshes of a line drawing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.local import check_free, check_glb, write_all
from meshdeform.cli.options import ForceOption, JsonOption, file_argument, flag, option, output_option
from meshdeform.cli.output import emit
from meshdeform.cli.request import split_pairs
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.kinds.sketch.guessing import Guess


@clean_errors
def sketch(
    drawing: Annotated[
        Path | None, file_argument("The PNG, JPEG or WebP. Without it, --noun and --set alone make a mesh.")
    ] = None,
    output: Annotated[Path | None, output_option("The GLB of the first guess. Default: DRAWING.glb here.")] = None,
    noun: Annotated[str, option("What is drawn, such as chair: nothing else is considered.")] = "",
    change: Annotated[
        list[str] | None, flag("--set", "A slider of the first guess as NAME=VALUE; may be repeated.")
    ] = None,
    among: Annotated[
        Path | None,
        typer.Option(
            help="Choose among these assets instead: a folder or a ZIP, such as a family's shapes.", exists=True
        ),
    ] = None,
    sliders: Annotated[bool, flag("--sliders", "List the sliders of --noun, and end.")] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Guess what DRAWING shows, and write the first three guesses as meshes and as one picture.

    meshdeform sketch chair.png -o chair.glb --set legs=0.5
    """
    require("scipy", "deform")
    from meshdeform.words import WordFolder, in_use

    if among is not None:
        if drawing is None:
            raise ParameterError("There is no drawing to choose by.", advice="Name a picture.")
        _choose(drawing, among, output or Path(f"{drawing.stem}.glb"), force=force, as_json=as_json)
        return
    with in_use(WordFolder(load_settings().words_folder).words()):
        if sliders:
            _list(noun, as_json=as_json)
            return
        changes = {name: text.strip() for name, text in split_pairs(change or [], "--set")}
        answers = _guesses(drawing, noun, changes)
        output = output or Path(f"{drawing.stem if drawing else answers[0].noun}.glb")
        check_glb(output)
        paths = [output, *(output.with_suffix(f".{number}.glb") for number in range(2, len(answers) + 1))]
        picture = output.with_suffix(".png")
        if drawing is not None and picture.exists() and picture.samefile(drawing):
            picture = output.with_suffix(".guesses.png")
        check_free([*paths, picture], [drawing], force=force)
        _write(answers, paths, picture)
    _tell(answers, paths, picture, noun, as_json=as_json)


def _tell(answers: Sequence[Guess], paths: Sequence[Path], picture: Path, noun: str, *, as_json: bool) -> None:
    """Print what was written, and whether the first guess is unsure."""
    from meshdeform.kinds.sketch.guessing import is_unsure

    unsure = is_unsure(answers, noun=noun)
    if as_json:
        guesses = [
            {"noun": each.noun, "probability": each.probability, "sliders": each.values, "file": str(path)}
            for each, path in zip(answers, paths, strict=True)
        ]
        emit({"guesses": guesses, "unsure": unsure, "picture": str(picture)})
        return
    for each, path in zip(answers, paths, strict=True):
        typer.echo(f"{path}: {_words(each)}")
    typer.echo(f"{picture}: all of them")
    if unsure:
        typer.echo("The first guess is unsure. If it is wrong, name what is drawn with --noun.", err=True)


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
    nearest = [list(files)[number] for number in apart.argsort()[:3]]
    starts = ("", ".2", ".3")
    chosen = {output.with_suffix(start + Path(name).suffix): name for start, name in zip(starts, nearest, strict=False)}
    check_free(list(chosen), [drawing], force=force)
    write_all({path: files[name] for path, name in chosen.items()}, what="The assets")
    if as_json:
        emit({"chosen": [{"name": name, "file": str(path)} for path, name in chosen.items()]})
        return
    for path, name in chosen.items():
        typer.echo(f"{path}: {name}")


def _guesses(drawing: Path | None, noun: str, changes: dict[str, str]) -> list[Guess]:
    """Return the guesses, the first one with the changes; without a drawing, the shape of a noun."""
    from meshdeform.kinds.sketch.guessing import Guess, guess

    if drawing is None:
        if not noun:
            raise ParameterError("There is neither a drawing nor a noun.", advice="Name a picture, or --noun.")
        return [Guess.of(noun, 1.0, changes)]
    first, *others = guess(drawing.read_bytes(), noun=noun)
    return [Guess.of(first.noun, first.probability, {**first.values, **changes}), *others]


def _write(guesses: Sequence[Guess], paths: Sequence[Path], picture: Path) -> None:
    """Write the meshes and the picture of them, all or none."""
    from meshdeform.assets import Limits, load_asset
    from meshdeform.runs.sheets import assets_png

    files = {path: each.glb() for each, path in zip(guesses, paths, strict=True)}
    assets = [load_asset(data, "shape.glb", Limits.unlimited()) for data in files.values()]
    titles = [f"{each.noun} {each.probability:.0%}" for each in guesses]
    files[picture] = assets_png(assets, titles)
    write_all(files, what="The meshes")


def _words(guess: Guess) -> str:
    """Return a guess with those of its sliders that are not as the noun is."""
    from meshdeform.kinds.sketch.shapes import sliders_of

    default = sliders_of(guess.noun).defaults()
    changed = {name: value for name, value in guess.values.items() if value != default[name]}
    values = ", ".join(f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
                       for name, value in changed.items())  # fmt: skip
    return f"{guess.noun} ({guess.probability:.0%}) {values}".rstrip()


def _list(noun: str, *, as_json: bool) -> None:
    """Print the sliders of a noun, with ranges, options and defaults."""
    from meshdeform.kinds.sketch.shapes import described, known_noun, sliders_of

    noun = known_noun(noun)
    if as_json:
        about = described(noun, {})
        emit({"sliders": [{name: value for name, value in each.items() if name != "value"} for each in about]})
        return
    sliders = sliders_of(noun)
    for choice in sliders.choices:
        typer.echo(f"{choice.name:<12} {', '.join(choice.options)}; default {choice.default}")
    for number in sliders.numbers:
        typer.echo(f"{number.name:<12} {number.low:g} to {number.high:g}; default {number.default:g}")


COMMANDS = (sketch,)
