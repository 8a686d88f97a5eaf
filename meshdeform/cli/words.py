"""`meshdeform words`: words of your own, made of meshes and kept in a folder of this machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.local import check_free, write_all
from meshdeform.cli.options import ForceOption, JsonOption, option, output_option
from meshdeform.cli.output import emit, plain, table

if TYPE_CHECKING:
    from meshdeform.words import Word, WordFolder

words = typer.Typer(help="Make, list and share words of your own: meshes that prompts can name.", no_args_is_help=True)

_NounArgument = Annotated[str, typer.Argument(help="A word of yours.")]
_ReplaceOption = Annotated[
    bool, typer.Option("--replace", help="Take the place of your word of that noun, or of ours, for yourself.")
]


@words.command()
@clean_errors
def add(
    meshes: Annotated[
        list[Path],
        typer.Argument(metavar="FILE|FOLDER...", exists=True, help="Meshes, folders of them, or a fitted family."),
    ],
    noun: Annotated[str, option("What they are: dragonfruit. Several words are joined: dragon-fruit.")],
    synonym: Annotated[list[str] | None, option("Another name for it; repeatable.")] = None,
    like: Annotated[
        str | None, option("A noun of ours as whose parts theirs are read: cat. Default: what the first looks like.")
    ] = None,
    front: Annotated[
        list[str] | None,
        option(
            "Where they face, in degrees: 0 is +Z, 90 is +X; or where one of them does, FILE=DEGREES. Repeatable. "
            "Default: found with the parts, else +Z.",
            metavar="[FILE=]DEGREES",
        ),
    ] = None,
    licence: Annotated[str, option("The licence of the meshes, in a few words.")] = "",
    replace: _ReplaceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Make a word of meshes, and keep it: prompts can name it at once.

    meshdeform words add fruit/*.glb --noun dragonfruit

    meshdeform words add okapi.glb --noun okapi --like horse
    """
    require("fast_simplification", "deform")
    from meshdeform.words import check_names, read_like, read_name

    store = _store()
    named, synonyms = read_name(noun), tuple(read_name(each, "synonyms") for each in synonym or ())
    check_names(named, synonyms, store.words(), replace=replace)
    offered = {"noun": named, "synonyms": synonyms, "like": read_like(like or ""), "licence": licence, **_fronts(front)}
    word = _made(offered, _found(meshes))
    store.add([word], replace=replace)
    _tell([word], as_json=as_json)


@words.command(name="list")
@clean_errors
def list_(as_json: JsonOption = False) -> None:
    """List your words."""
    _tell(_store().words(), as_json=as_json)


@words.command()
@clean_errors
def show(
    noun: _NounArgument,
    picture: Annotated[
        Path | None, option("Also draw its meshes, coloured by their parts, as this .png.", dir_okay=False)
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Show what a word of yours consists of."""
    from meshdeform.words import read_name

    word = _store().word(read_name(noun))
    if picture is not None:
        check_free([picture], force=force)
        require("torch", "deform")
        from meshdeform.runs.word_picture import word_png

        write_all({picture: word_png(word)}, what=picture)
    if as_json:
        emit(_document(word))
        return
    typer.echo(_described(word))


@words.command()
@clean_errors
def remove(nouns: Annotated[list[str], typer.Argument(metavar="NOUN...", help="Words of yours.")]) -> None:
    """Remove words of yours. Jobs that have them keep them."""
    from meshdeform.words import read_name

    _store().remove([read_name(noun) for noun in nouns])


@words.command()
@clean_errors
def export(
    nouns: Annotated[list[str], typer.Argument(metavar="NOUN...", help="Words of yours.")],
    output: Annotated[Path, output_option("The file to write: fruit.word.")],
    force: ForceOption = False,
) -> None:
    """Write words of yours into one file, for other machines and services."""
    from meshdeform.words import joined, read_name

    check_free([output], force=force)
    store = _store()
    chosen = {(name := read_name(noun)): store.word(name) for noun in nouns}
    write_all({output: joined(chosen.values())}, what=output)


@words.command(name="import")
@clean_errors
def import_(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="A file that `export` wrote.")],
    replace: _ReplaceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Keep the words of a file, all or none."""
    from meshdeform.words import read_words

    found = [word.checked() for word in read_words(file.read_bytes())]
    _store().add(found, replace=replace)
    _tell(found, as_json=as_json)


def _store() -> WordFolder:
    from meshdeform.words import WordFolder

    return WordFolder(load_settings().words_folder)


def _fronts(texts: Sequence[str] | None) -> dict[str, Any]:
    """Return where all meshes face, and where some do, of texts of the form DEGREES or FILE=DEGREES."""
    front_deg, fronts = None, dict[str, float]()
    for text in texts or ():
        name, equals, angle = text.rpartition("=")
        try:
            degrees = float(angle)
        except ValueError:
            raise typer.BadParameter(f"{text!r} is not [FILE=]DEGREES", param_hint="--front") from None
        if not -360 <= degrees <= 360:
            raise typer.BadParameter(f"{angle} is not between -360 and 360", param_hint="--front")
        if equals:
            fronts[Path(name).name] = degrees
        else:
            front_deg = degrees
    return {"front_deg": front_deg, "fronts": fronts}


def _found(paths: Sequence[Path]) -> dict[str, Path]:
    """Return meshes by their names: files as they are, and of folders those whose names say that they are meshes."""
    from meshdeform.assets.inspect import FORMATS

    files = list[Path]()
    for path in paths:
        inner = sorted(each for each in path.rglob("*") if each.suffix.lower().removeprefix(".") in FORMATS - {"zip"})
        if path.is_dir() and not inner:
            raise typer.BadParameter(f"there is no mesh in {path}", param_hint="FILE|FOLDER")
        files += inner if path.is_dir() else [path]
    files = list(dict.fromkeys(files))
    counts = Counter(path.name for path in files)
    return {path.name if counts[path.name] == 1 else path.as_posix(): path for path in files}


def _made(offered: dict[str, Any], paths: dict[str, Path]) -> Word:
    from meshdeform.assets import Limits
    from meshdeform.assets.bundle import read_with_files
    from meshdeform.runs.kept_readings import FolderReadings
    from meshdeform.runs.word_making import make_word
    from meshdeform.words import WordOffer

    settings = load_settings()
    limits = Limits.from_settings(settings)
    files = {name: read_with_files(path, limits) for name, path in paths.items()}
    return make_word(WordOffer(**offered), files, limits, FolderReadings(settings.cache_folder))


def _document(word: Word) -> dict[str, Any]:
    return {
        **{name: value for name, value in word.told.items() if name != "shapes"},
        "meshes": [{**vars(source), "faces": faces} for source, faces in zip(word.sources, word.faces, strict=True)],
        "sha256": word.sha256,
        "bytes": len(word.data),
    }


def _tell(found: Iterable[Word], *, as_json: bool) -> None:
    """Print words as a table, or as JSON."""
    listed = list(found)
    if as_json:
        emit([_document(word) for word in listed])
        return
    rows = [
        (word.noun, f"{len(word.faces)}", ", ".join(word.parts), ", ".join(word.synonyms), word.sha256[:12])
        for word in listed
    ]
    if rows:
        typer.echo(table(("NOUN", "MESHES", "PARTS", "SYNONYMS", "SHA-256"), rows))
    else:
        typer.echo("You have no words yet: meshdeform words add --help.", err=True)


def _described(word: Word) -> str:
    lines = [
        word.noun,
        *([f"Also called {', '.join(word.synonyms)}."] if word.synonyms else []),
        *([f"Its parts were read as those of a {word.like}."] if word.like else []),
        f"Parts: {', '.join(word.parts) or 'none'}.",
        f"SHA-256 {word.sha256}, {len(word.data):,} bytes",
        "",
    ]
    rows = [
        (plain(source.source), f"{faces:,}", plain(source.licence), source.sha256[:12])
        for source, faces in zip(word.sources, word.faces, strict=True)
    ]
    return "\n".join(lines) + table(("MESH", "FACES", "LICENCE", "SHA-256 OF THE FILE"), rows)
