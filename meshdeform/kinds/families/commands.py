"""The commands `family-fit` and `family-synthesize`, and what they print."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import of_kind, with_options
from meshdeform.cli.kinds import packed, run_kind
from meshdeform.cli.options import Here, JobWhere, Printed, SetOption, output_option
from meshdeform.cli.report_lines import folder_summary
from meshdeform.cli.request import merge_params
from meshdeform.errors import ParameterError

_APART = 0.01
"""From this share of a shape's diagonal on, a gap between its parts is seen."""


@clean_errors
@with_options(of_kind("family_fit"))
def family_fit(
    ctx: typer.Context,
    collection: Annotated[
        Path,
        typer.Argument(
            help="A folder or a ZIP of 10 to 3,000 assets of one family, with labels.json, if some have labels "
            "(docs/families.md).",
            exists=True,
        ),
    ],
    output: Annotated[Path | None, output_option("The folder to write. Default: NAME-family.")] = None,
    param: SetOption = None,
    *,
    here: Here,
    where: JobWhere,
    printed: Printed,
) -> None:
    """Find the parts and the correspondences of a family of assets, and learn its shapes.

    meshdeform family-fit chairs/ -o chairs-family
    """
    output = output or Path(f"{collection.stem}-family")
    run_kind("family_fit", merge_params(ctx, param), {"collection": collection}, output, here, where, printed)


@clean_errors
@with_options(of_kind("family_synthesize"))
def family_synthesize(
    ctx: typer.Context,
    family: Annotated[
        Path, typer.Argument(help="The folder that family-fit wrote, or its family.safetensors.", exists=True)
    ],
    collection: Annotated[
        Path | None,
        typer.Argument(
            help="The folder or ZIP that was fitted. Default: labelled.zip beside the family, if it is there.",
            exists=True,
        ),
    ] = None,
    output: Annotated[Path | None, output_option("The folder to write. Default: NAME-shapes.")] = None,
    param: SetOption = None,
    *,
    here: Here,
    where: JobWhere,
    printed: Printed,
) -> None:
    """Make new assets of a family out of parts of its members.

    meshdeform family-synthesize chairs-family chairs/ --count 8
    """
    files = _files_of(family, collection)
    output = output or Path(f"{family.stem}-shapes")
    run_kind("family_synthesize", merge_params(ctx, param), files, output, here, where, printed)


def _files_of(family: Path, collection: Path | None) -> dict[str, Path]:
    """Return the files of a fitted family, which is a folder or a file, by part.

    Raises ParameterError: one is missing.
    """
    source = family / "family.safetensors" if family.is_dir() else family
    files = {"family": source, "collection": collection or source.with_name("labelled.zip")}
    for path in files.values():
        if not path.exists():
            raise ParameterError(
                f"There is no {path}.",
                advice="Name the folder that meshdeform family-fit wrote, and the collection that it was fitted to.",
            )
    return files


def _is_family(path: Path) -> bool:
    return path.suffix == ".safetensors" or (path / "family.safetensors").is_file()


def _word_meshes(paths: Sequence[Path]) -> dict[str, bytes]:
    """Return meshes of a fitted family, which is the first path; the second, if there is one, is its collection."""
    from meshdeform.assets import Limits

    if not _is_family(paths[0]) or len(paths) > 2:
        raise typer.BadParameter(
            "a family comes alone, or before the folder or ZIP that it was fitted to", param_hint="FILE|FOLDER"
        )
    files = _files_of(paths[0], paths[1] if len(paths) > 1 else None)
    require("torch", "sds")
    from meshdeform.kinds.families.word_meshes import family_meshes

    with tempfile.TemporaryDirectory(prefix="meshdeform-") as folder:
        collection = packed(files["collection"], Path(folder)).read_bytes()
    limits = Limits.from_settings(load_settings())
    return family_meshes(files["family"].read_bytes(), collection, limits)


def _family_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    yield f"Folder     {summary['folder']}"
    yield f"Files      {', '.join(summary['files'])}"
    yield f"Parts      {', '.join(summary['parts'])}"
    if accuracy := summary["accuracy"]:
        yield f"Accuracy   {accuracy['parts']:.1%} of the surface of {accuracy['held_out']} held-out assets"
    if summary["classes"]:
        yield f"Classes    {summary['classes']['nearest_neighbour']:.1%} have a nearest neighbour of their class"


def _shape_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    yield f"Folder     {summary['folder']}"
    yield f"Files      {', '.join(summary['files'])}"
    for shape in summary["shapes"]:
        parts = ", ".join(f"{each['part']} of {each['member']}" for each in shape["parts"])
        loose, gap = shape["loose"], max((each["gap"] for each in shape["parts"]), default=0)
        apart = [f"loose: {', '.join(loose)}"] * bool(loose) + [f"parts up to {gap:.1%} apart"] * (gap > _APART)
        phrases = [parts, *apart, f"most like {shape['nearest_members'][0]['name']}"]
        yield f"{shape['name']}  {'; '.join(phrases)}"
    for each in summary["nearest_members"] or ():
        yield f"{each['distance']:9.3f}  {each['name']}"


COMMANDS = (family_fit, family_synthesize)

PRINTED = {
    "family_fit": (folder_summary, _family_lines),
    "family_synthesize": (folder_summary, _shape_lines),
}

WORD_SOURCES = ((_is_family, _word_meshes),)
