"""Read and validate the rows of a batch; give each a readable name and a key that depends on its contents alone."""

from __future__ import annotations

import csv
import functools
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.cli.form import overlaid
from meshdeform.cli.request import make_request
from meshdeform.errors import MeshdeformError, ParameterError
from meshdeform.support.files import slug

if TYPE_CHECKING:
    from meshdeform.requests.document import DeformParams, JobRequest

_ASSET_SUFFIXES = frozenset({".glb", ".obj", ".ply", ".stl", ".zip"})
TABLE_SUFFIXES = {".csv": ",", ".tsv": "\t", ".jsonl": "", ".ndjson": ""}
_ADVICE = "docs/cli.md describes manifests under meshdeform batch."
_MEMBERS = ("asset", "prompt", "name", "target", "morph")
_TRUE, _FALSE = frozenset({"true", "1", "yes"}), frozenset({"false", "0", "no"})
_MAX_LISTED = 20
_MAX_NAME = 100
_NAME = re.compile(r"[^\W_][\w .,+()-]*")


@dataclass(frozen=True)
class Entry:
    """One row as written, at a `location` for errors: `manifest.csv, line 3`; its parameters are not validated yet.

    `name` is that of its folder in the folder of the batch; if empty, it is made from asset and prompt.
    """

    location: str
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
    """
    separator = TABLE_SUFFIXES[path.suffix.lower()]
    text = _read_text(path, "A manifest must be UTF-8 text.")
    lines = _cells(path, text, separator) if separator else _objects(path, text)
    entries = [_entry(f"{path.name}, line {number}", path.parent, members) for number, members in lines]
    if not entries:
        raise ParameterError(f"{path} has no rows.", advice=_ADVICE)
    return entries


def combine(source: Path, prompts: Sequence[str]) -> list[Entry]:
    """Combine every asset of a folder, or a single asset, with every prompt."""
    if not prompts:
        raise ParameterError(
            f"{source} is not a manifest, so prompts are required.",
            advice="Give --prompt (repeatable) or --prompts-file; or a manifest as .csv, .tsv or .jsonl.",
        )
    assets = (
        [source] if source.is_file() else sorted(p for p in source.iterdir() if p.suffix.lower() in _ASSET_SUFFIXES)
    )
    if not assets:
        raise ParameterError(
            f"There is no asset in {source}.", advice=f"Assets end in {', '.join(sorted(_ASSET_SUFFIXES))}."
        )
    return [Entry(f"{asset.name} with {prompt!r}", asset, prompt) for asset in assets for prompt in prompts]


def read_prompts(path: Path) -> list[str]:
    """Read one prompt per line; empty lines and lines that begin with # are skipped."""
    lines = _read_text(path, "The file must be UTF-8 text, one prompt per line.").splitlines()
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def _read_text(path: Path, advice: str) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path} cannot be read: {error}.", advice=advice) from error


def _cells(path: Path, text: str, separator: str) -> Iterator[tuple[int, dict[str, Any]]]:
    reader = csv.DictReader(text.splitlines(), delimiter=separator, strict=True)
    try:
        for row in reader:
            if None in row:
                raise ParameterError(
                    f"{path.name}, line {reader.line_num}, has more cells than there are columns.",
                    advice="Quote cells that hold the separator.",
                )
            cells = {name.strip(): (cell or "").strip() for name, cell in row.items()}
            yield reader.line_num, {name: _value(name, cell) for name, cell in cells.items() if cell}
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


def _entry(location: str, folder: Path, members: dict[str, Any]) -> Entry:
    if "output" in members:
        members["name"] = members.pop("output")
    asset = members.get("asset")
    if not isinstance(asset, str) or not asset:
        raise ParameterError(f"{location}: the asset is missing.", advice="Its column is `asset`.")
    target = members.get("target")
    return Entry(
        location=location,
        asset=folder / asset,
        prompt=str(members.get("prompt", "")),
        name=str(members.get("name", "")),
        target=folder / str(target) if target else None,
        morph=_is_morph(location, members.get("morph", False)),
        params={name: value for name, value in members.items() if name not in _MEMBERS},
    )


def _is_morph(location: str, value: Any) -> bool:
    text = str(value).lower()
    if text not in _TRUE | _FALSE:
        raise ParameterError(f"{location}: morph is {value!r}, not true or false.", advice=_ADVICE)
    return text in _TRUE


@dataclass(frozen=True)
class Row:
    """One deformation.

    `key` is a digest of everything that decides the result: the bytes of the files, the prompt, the parameters. `name`
    is unique: its folder in the folder of the batch.
    """

    key: str
    name: str
    location: str
    asset: Path
    request: JobRequest
    target: Path | None = None

    def path(self, folder: Path, artifact: str) -> Path:
        """Return the path of an artifact in the folder of the batch."""
        return folder / self.name / artifact


def make_rows(
    entries: Sequence[Entry],
    *,
    defaults: Mapping[str, Any],
    seeds: Sequence[int] = (),
    output: Mapping[str, bool] | None = None,
    known_names: Mapping[str, str] | None = None,
    check: Callable[[JobRequest, bool], JobRequest] = lambda request, _has_target: request,
) -> tuple[list[Row], list[str]]:
    """Validate every row before the first one begins; return the rows, and the locations of repeated ones, left out.

    A row without a seed is done once for each of `seeds`. `known_names` are those by key from an earlier run of the
    batch, which are kept. `check` is called with each request and whether it has a target, and returns it as it is to
    run, or raises if it is invalid.
    A ParameterError lists invalid rows.
    """
    digest, wrong = functools.cache(_digest), list[dict[str, str]]()
    unique: dict[str, tuple[Entry, JobRequest]] = {}
    repeated = []
    for entry in entries:
        for seed in seeds if seeds and "seed" not in entry.params else (None,):
            params = {**defaults, **({"seed": seed} if seed is not None else {})}
            try:
                request = check(_request(entry, params, output or {}), entry.target is not None)
                key = _key(entry, request, digest)
            except MeshdeformError as error:
                wrong.append({"place": entry.location, "code": error.code, "detail": _with_suggestions(error)})
                break
            if key in unique:
                repeated.append(entry.location)
            else:
                unique[key] = (entry, request)
    if wrong:
        raise _refusal(wrong, len(entries))
    names = _names(unique, known_names or {}, with_seed=len(seeds) > 1)
    rows = [
        Row(key, names[key], entry.location, entry.asset, request, entry.target)
        for key, (entry, request) in unique.items()
    ]
    return rows, repeated


def _request(entry: Entry, defaults: Mapping[str, Any], output: Mapping[str, bool]) -> JobRequest:
    from meshdeform.requests.choices import GuidanceKind
    from meshdeform.requests.groups import grouped, without_unused

    if entry.name and (not _NAME.fullmatch(entry.name) or len(entry.name) > _MAX_NAME):
        raise ParameterError(
            f"{entry.name!r} is not a valid folder name.", advice="Use letters, digits, spaces and -_.,+()."
        )
    fitted = defaults.get("guidance", {}).get("kind") == GuidanceKind.EXEMPLAR
    guidance = {"guidance": {"kind": "target"}} if entry.target and not fitted else {}
    params = overlaid(overlaid(defaults, guidance), grouped(entry.params))
    if entry.target:  # what the command says for rows with a prompt
        params = without_unused(params)
    own = {"morph": True} if entry.morph else {}
    return make_request(entry.prompt, params, output={**output, **own})


def _with_suggestions(error: MeshdeformError) -> str:
    prompts = " or ".join(map(repr, error.extra.get("suggestions", ())))
    return f"{error.detail} Try {prompts}." if prompts else error.detail


def _refusal(wrong: list[dict[str, str]], total: int) -> ParameterError:
    lines = [f"{each['place']}: {each['detail']}" for each in wrong[:_MAX_LISTED]]
    if len(wrong) > _MAX_LISTED:
        lines.append(f"and {len(wrong) - _MAX_LISTED} more")
    return ParameterError(
        f"{len(wrong)} of {total} rows are invalid:\n" + "\n".join(lines),
        advice="Nothing was started. Correct them and run the same command.",
        errors=wrong,
    )


def _key(entry: Entry, request: JobRequest, digest: Callable[[Path], str]) -> str:
    files = [digest(entry.asset), digest(entry.target) if entry.target else ""]
    content = request.model_dump(mode="json", exclude_defaults=True, exclude={"params"})
    content |= {"params": params} if (params := _chosen(request.params)) else {}
    return hashlib.sha256(json.dumps([files, content, entry.name], sort_keys=True).encode()).hexdigest()


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ParameterError(f"{path} cannot be read: {error.strerror}.", advice="Check the path.") from error


def _chosen(params: DeformParams) -> dict[str, Any]:
    """Return the parameters that were written, without those equal to a default that no preset changes."""
    from pydantic_core import to_jsonable_python

    from meshdeform.requests.parameters import FROM_PRESET, ResolvedParams

    fields = {name: field for name, field in ResolvedParams.model_fields.items() if name not in FROM_PRESET}
    defaults = to_jsonable_python({name: field.default for name, field in fields.items()})
    values = to_jsonable_python({**params.flat(), "guidance": getattr(params.guidance, "kind", None)})
    return {name: value for name, value in values.items() if name not in defaults or value != defaults[name]}


def _names(
    chosen: Mapping[str, tuple[Entry, JobRequest]], known: Mapping[str, str], *, with_seed: bool
) -> dict[str, str]:
    names = {key: known[key] for key in chosen if key in known}
    used = {name.casefold() for name in known.values()}  # some file systems ignore the case
    for key, (entry, request) in chosen.items():
        if key in names:
            continue
        base = entry.name or "-".join(slug(text) or "x" for text in (entry.asset.stem, _goal(entry, request)))
        if with_seed and "seed" not in entry.params:
            base += f"-seed{request.params.seed}"
        # With its digest, the name does not depend on rows added later.
        names[key] = f"{base}-{key[:8]}" if base.casefold() in used else base
        used.add(names[key].casefold())
    return names


def _goal(entry: Entry, request: JobRequest) -> str:
    return request.prompt or (f"like {entry.target.stem}" if entry.target else "")
