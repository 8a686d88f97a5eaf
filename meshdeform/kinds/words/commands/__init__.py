"""`meshdeform words`: words of your own, made of meshes and kept in a folder of this machine, or at a service."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from meshdeform.cli.exits import clean_errors
from meshdeform.cli.local import check_free, write_all
from meshdeform.cli.options import ForceOption, JsonOption, Where, option, output_option
from meshdeform.cli.output import emit, plain, table
from meshdeform.kinds.words.commands.keepers import FolderWords, ServiceWords
from meshdeform.requests.kind_folders import kind_modules

words = typer.Typer(help="Make, list and share words of your own: meshes that prompts can name.", no_args_is_help=True)

GROUPS = {"words": words}

_NounArgument = Annotated[str, typer.Argument(help="A word of yours.")]
_ReplaceOption = Annotated[
    bool, typer.Option("--replace", help="Take the place of your word of that noun, or of ours, for yourself.")
]


@dataclass(frozen=True)
class WordWhere(Where):
    """The service that keeps words instead of this machine."""

    # Without the variable: the address alone decides where words are kept, as it does where jobs run.
    url: Annotated[
        str | None, option("Your words at this service, instead of this machine's.", "Service", metavar="URL")
    ] = None


@words.command()
@clean_errors
def add(
    meshes: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE|FOLDER...",
            exists=True,
            help="Meshes, folders of them, or a fitted family and its collection.",
        ),
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
    *,
    where: WordWhere,
    as_json: JsonOption = False,
) -> None:
    """Make a word of meshes, and keep it: prompts can name it at once.

    meshdeform words add fruit/*.glb --noun dragonfruit

    meshdeform words add guanaco.glb --noun guanaco --like sheep --synonym huanaco

    meshdeform words add stools-family/family.safetensors stools/ --noun bar-stool
    """
    from meshdeform.words import read_like, read_name

    said = {
        "noun": read_name(noun),
        "synonyms": [read_name(each, "synonyms") for each in synonym or ()],
        "like": read_like(like or ""),
        "licence": licence,
        **_fronts(front),
    }
    with _kept(where) as kept, _meshes(meshes) as files:
        _tell([kept.add(said, files, replace=replace)], as_json=as_json)


@words.command(name="list")
@clean_errors
def list_(*, where: WordWhere, as_json: JsonOption = False) -> None:
    """List your words."""
    with _kept(where) as kept:
        _tell(kept.all(), as_json=as_json)


@words.command()
@clean_errors
def show(
    noun: _NounArgument,
    picture: Annotated[
        Path | None, option("Also draw its meshes, coloured by their parts, as this .png.", dir_okay=False)
    ] = None,
    force: ForceOption = False,
    *,
    where: WordWhere,
    as_json: JsonOption = False,
) -> None:
    """Show what a word of yours consists of."""
    from meshdeform.words import read_name

    with _kept(where) as kept:
        word = kept.one(read_name(noun))
        if picture is not None:
            check_free([picture], force=force)
            write_all({picture: kept.picture(word["noun"])}, what=picture)
    if as_json:
        emit(word)
        return
    typer.echo(_described(word))


@words.command()
@clean_errors
def remove(
    nouns: Annotated[list[str], typer.Argument(metavar="NOUN...", help="Words of yours.")], *, where: WordWhere
) -> None:
    """Remove words of yours. Jobs that have them keep them."""
    from meshdeform.words import read_name

    with _kept(where) as kept:
        kept.remove([read_name(noun) for noun in nouns])


@words.command()
@clean_errors
def export(
    nouns: Annotated[list[str], typer.Argument(metavar="NOUN...", help="Words of yours.")],
    output: Annotated[Path, output_option("The file to write: fruit.word.")],
    force: ForceOption = False,
    *,
    where: WordWhere,
) -> None:
    """Write words of yours into one file, for other machines and services."""
    from meshdeform.words import Word, joined, read_name

    check_free([output], force=force)
    with _kept(where) as kept:
        chosen = {(name := read_name(noun)): Word.read(kept.content(name)) for noun in nouns}
    write_all({output: joined(chosen.values())}, what=output)


@words.command(name="import")
@clean_errors
def import_(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="A file that `export` wrote.")],
    replace: _ReplaceOption = False,
    *,
    where: WordWhere,
    as_json: JsonOption = False,
) -> None:
    """Keep the words of a file, all or none."""
    with _kept(where) as kept:
        _tell(kept.take(file.read_bytes(), replace=replace), as_json=as_json)


@contextmanager
def _kept(where: WordWhere) -> Iterator[FolderWords | ServiceWords]:
    """Provide the words of the service that is named, or of this machine."""
    if not where.url:
        yield FolderWords()
        return
    with where.connect() as client:
        yield ServiceWords(client)


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
    return {"front": front_deg, "fronts": fronts}


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


@contextmanager
def _meshes(paths: Sequence[Path]) -> Iterator[dict[str, Path]]:
    """Yield meshes by their names, those that a kind of job makes of what it wrote in a folder that goes afterwards."""
    sources = [source for module in kind_modules("commands") for source in getattr(module, "WORD_SOURCES", ())]
    made = next((make for takes, make in sources if any(takes(path) for path in paths)), None)
    if made is None:
        yield _found(paths)
        return
    with tempfile.TemporaryDirectory(prefix="meshdeform-") as folder:
        meshes = made(paths)
        files = {name: Path(folder) / f"{number}.glb" for number, name in enumerate(meshes)}
        for name, path in files.items():
            path.write_bytes(meshes[name])
        yield files


def _tell(found: Sequence[dict[str, Any]], *, as_json: bool) -> None:
    """Print words as a table, or as JSON."""
    if as_json:
        emit(found)
        return
    rows = [
        (each["noun"], f"{each['meshes']}", ", ".join(each["parts"]), ", ".join(each["synonyms"]), each["sha256"][:12])
        for each in found
    ]
    if rows:
        typer.echo(table(("NOUN", "MESHES", "PARTS", "SYNONYMS", "SHA-256"), rows))
    else:
        typer.echo("You have no words yet: meshdeform words add --help.", err=True)


def _described(word: dict[str, Any]) -> str:
    lines = [
        word["noun"],
        *([f"Also called {', '.join(word['synonyms'])}."] if word["synonyms"] else []),
        *([f"Its parts were read as those of a {word['like']}."] if word["like"] else []),
        f"Parts: {', '.join(word['parts']) or 'none'}.",
        f"SHA-256 {word['sha256']}, {word['size']:,} bytes",
        "",
    ]
    rows = [
        (plain(each["source"]), f"{each['faces']:,}", plain(each["licence"]), each["sha256"][:12])
        for each in word["sources"]
    ]
    return "\n".join(lines) + table(("MESH", "FACES", "LICENCE", "SHA-256 OF THE FILE"), rows)
