"""Read the entries of a batch: a table, or a folder of assets combined with prompts."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from meshdeform.errors import ParameterError

__all__ = ["ASSET_SUFFIXES", "TABLE_SUFFIXES", "Entry", "combine", "read_prompts", "read_table"]

ASSET_SUFFIXES = frozenset({".glb", ".obj", ".ply", ".stl", ".zip"})
TABLE_SUFFIXES = {".csv": ",", ".tsv": "\t", ".jsonl": "", ".ndjson": ""}
_ADVICE = "docs/cli.md describes manifests under meshdeform batch."
_MEMBERS = ("asset", "prompt", "name", "target", "morph")
_TRUE, _FALSE = frozenset({"true", "1", "yes"}), frozenset({"false", "0", "no"})


@dataclass(frozen=True)
class Entry:
    """One row as written.

    Attributes
    ----------
    place : str
        Where it was written, for errors: `manifest.csv, line 3`.
    asset : Path
    prompt : str
    name : str
        Name of its folder in the folder of the batch; if empty, made from asset and prompt.
    target : Path, optional
    morph : bool
    params : dict
        Parameters of this row, not validated yet.
    """

    place: str
    asset: Path
    prompt: str = ""
    name: str = ""
    target: Path | None = None
    morph: bool = False
    params: dict[str, Any] = field(default_factory=dict)


def read_table(path: Path) -> list[Entry]:
    """Read the rows of a CSV, TSV or JSON Lines file; paths in it are relative to its folder.

    Columns are `asset`, `prompt`, `name` (or `output`), `target`, `morph`, and any parameter; an empty cell
    counts as left out.

    Raises
    ------
    ParameterError
        The file cannot be read, or a row has no asset.
    """
    separator = TABLE_SUFFIXES[path.suffix.lower()]
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path} cannot be read: {error}.", advice="A manifest must be UTF-8 text.") from error
    lines = _cells(path, text, separator) if separator else _objects(path, text)
    entries = [_entry(f"{path.name}, line {number}", path.parent, members) for number, members in lines]
    if not entries:
        raise ParameterError(f"{path} has no rows.", advice=_ADVICE)
    return entries


def combine(place: Path, prompts: Sequence[str]) -> list[Entry]:
    """Combine every asset of a folder, or a single asset, with every prompt.

    Raises
    ------
    ParameterError
        There are no assets, or no prompts.
    """
    if not prompts:
        raise ParameterError(
            f"{place} is not a manifest, so prompts are required.",
            advice="Give --prompt (repeatable) or --prompts-file; or a manifest as .csv, .tsv or .jsonl.",
        )
    assets = [place] if place.is_file() else sorted(p for p in place.iterdir() if p.suffix.lower() in ASSET_SUFFIXES)
    if not assets:
        raise ParameterError(
            f"There is no asset in {place}.", advice=f"Assets end in {', '.join(sorted(ASSET_SUFFIXES))}."
        )
    return [Entry(f"{asset.name} with {prompt!r}", asset, prompt) for asset in assets for prompt in prompts]


def read_prompts(path: Path) -> list[str]:
    """Read one prompt per line; empty lines and lines that begin with # are skipped.

    Raises
    ------
    ParameterError
        The file cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(
            f"{path} cannot be read: {error}.", advice="The file must be UTF-8 text, one prompt per line."
        ) from error
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def _cells(path: Path, text: str, separator: str) -> Iterator[tuple[int, dict[str, Any]]]:
    reader = csv.DictReader(text.splitlines(), delimiter=separator, strict=True)
    try:
        for row in reader:
            if None in row:
                raise ParameterError(
                    f"{path.name}, line {reader.line_num}, has more cells than there are columns.",
                    advice="Quote cells that hold the separator.",
                )
            found = {name.strip(): (cell or "").strip() for name, cell in row.items()}
            yield reader.line_num, {name: _value(name, cell) for name, cell in found.items() if cell}
    except csv.Error as error:
        raise ParameterError(f"{path.name}, line {reader.line_num}: {error}.", advice=_ADVICE) from error


def _objects(path: Path, text: str) -> Iterator[tuple[int, dict[str, Any]]]:
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            members = json.loads(line)
        except ValueError as error:
            raise ParameterError(f"{path.name}, line {number}, is not JSON: {error}.", advice=_ADVICE) from error
        if not isinstance(members, dict):
            raise ParameterError(f"{path.name}, line {number}, is not a JSON object.", advice=_ADVICE)
        params = members.pop("params", {})
        yield number, {name: value for name, value in {**params, **members}.items() if value is not None}


def _value(name: str, cell: str) -> Any:
    """Return the value of a cell: text in text columns, else JSON if it parses."""
    if name in (*_MEMBERS, "output", "model", "negative_prompt"):
        return cell
    try:
        return json.loads(cell)
    except ValueError:
        return cell


def _entry(place: str, folder: Path, members: dict[str, Any]) -> Entry:
    if "output" in members:
        members["name"] = members.pop("output")
    asset = members.get("asset")
    if not isinstance(asset, str) or not asset:
        raise ParameterError(f"{place}: the asset is missing.", advice="Its column is `asset`.")
    target = members.get("target")
    return Entry(
        place=place,
        asset=folder / asset,
        prompt=str(members.get("prompt", "")),
        name=str(members.get("name", "")),
        target=folder / str(target) if target else None,
        morph=_flag(place, "morph", members.get("morph", False)),
        params={name: value for name, value in members.items() if name not in _MEMBERS},
    )


def _flag(place: str, name: str, value: Any) -> bool:
    text = str(value).lower()
    if text not in _TRUE | _FALSE:
        raise ParameterError(f"{place}: {name} is {value!r}, not true or false.", advice=_ADVICE)
    return text in _TRUE
