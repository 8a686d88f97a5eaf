"""The rows of a batch: checked, with a name for people and a key that is the same as long as the row is."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.cli.batches.manifest import Wish
from meshdeform.cli.request import make_request
from meshdeform.errors import MeshdeformError, ParameterError

if TYPE_CHECKING:
    from meshdeform.requests.document import DeformParams, JobRequest

__all__ = ["Row", "make_rows"]

_MAX_TOLD = 20
_MAX_NAME = 100
_NAME = re.compile(r"[^\W_][\w .,+()-]*")


@dataclass(frozen=True)
class Row:
    """One deformation.

    Attributes
    ----------
    key : str
        A digest of all that decides the result: the bytes of the files, the prompt, the parameters.
    name : str
        Its folder below the batch's; no two rows have the same.
    place : str
        Where it was written.
    asset : Path
    request : JobRequest
    target : Path, optional
    """

    key: str
    name: str
    place: str
    asset: Path
    request: JobRequest
    target: Path | None = None


def make_rows(
    wishes: Sequence[Wish],
    *,
    defaults: Mapping[str, Any],
    seeds: Sequence[int] = (),
    morph: bool = False,
    usd: bool = False,
    known_names: Mapping[str, str] | None = None,
    check: Callable[[JobRequest, bool], None] = lambda _request, _has_target: None,
) -> tuple[list[Row], list[str]]:
    """Check every row before the first one is begun.

    Parameters
    ----------
    wishes : sequence of Wish
    defaults : mapping
        Parameters where a row says nothing.
    seeds : sequence of int
        A row without a seed of its own is done once for each.
    morph, usd : bool
        Whether every row makes a morph, and a USDZ.
    known_names : mapping, optional
        Names by key from an earlier run of the batch; they stay.
    check : callable
        Gets each request and whether there is a target; raises what is wrong with it.

    Returns
    -------
    rows : list of Row
    repeated : list of str
        Places that ask for exactly what another one asks for; they are left out.

    Raises
    ------
    ParameterError
        Something is wrong, of which all places are told.
    """
    digest, wrong = _Digests(), list[dict[str, str]]()
    found: dict[str, tuple[Wish, JobRequest]] = {}
    repeated = []
    for wish in wishes:
        for seed in seeds if seeds and "seed" not in wish.params else (None,):
            params = {**defaults, **({"seed": seed} if seed is not None else {})}
            try:
                request = _request(wish, params, morph=morph, usd=usd)
                check(request, wish.target is not None)
                key = digest.key(wish, request)
            except MeshdeformError as error:
                wrong.append({"place": wish.place, "code": error.code, "detail": error.detail})
                break
            if key in found:
                repeated.append(wish.place)
            else:
                found[key] = (wish, request)
    if wrong:
        raise _refusal(wrong, len(wishes))
    names = _names(found, known_names or {}, with_seed=len(seeds) > 1)
    rows = [
        Row(key, names[key], wish.place, wish.asset, request, wish.target) for key, (wish, request) in found.items()
    ]
    return rows, repeated


def _request(wish: Wish, defaults: Mapping[str, Any], *, morph: bool, usd: bool) -> JobRequest:
    if wish.name and (not _NAME.fullmatch(wish.name) or len(wish.name) > _MAX_NAME):
        raise ParameterError(f"{wish.name!r} is no name for a folder.", advice="Letters, digits and -_.,+() will do.")
    guidance = {"guidance": "target"} if wish.target else {}
    params = {**defaults, **guidance, **wish.params}
    return make_request(wish.prompt, params, morph=morph or wish.morph, usd=usd or wish.usd)


def _refusal(wrong: list[dict[str, str]], total: int) -> ParameterError:
    lines = [f"{each['place']}: {each['detail']}" for each in wrong[:_MAX_TOLD]]
    if len(wrong) > _MAX_TOLD:
        lines.append(f"and {len(wrong) - _MAX_TOLD} more")
    return ParameterError(
        f"{len(wrong)} of {total} rows cannot be done as they stand:\n" + "\n".join(lines),
        advice="Nothing was begun. Mend them and give the same command.",
        errors=wrong,
    )


class _Digests:
    """SHA-256 of files, each read once."""

    def __init__(self) -> None:
        self._known: dict[Path, str] = {}

    def key(self, wish: Wish, request: JobRequest) -> str:
        files = [self._file(wish.asset), self._file(wish.target) if wish.target else ""]
        said = request.model_dump(mode="json", exclude_defaults=True, exclude={"params"})
        said |= {"params": params} if (params := _chosen(request.params)) else {}
        return hashlib.sha256(json.dumps([files, said, wish.name], sort_keys=True).encode()).hexdigest()

    def _file(self, path: Path) -> str:
        if path not in self._known:
            try:
                with path.open("rb") as file:
                    self._known[path] = hashlib.file_digest(file, "sha256").hexdigest()
            except OSError as error:
                raise ParameterError(f"{path} cannot be read: {error.strerror}.", advice="Check the path.") from error
        return self._known[path]


def _chosen(params: DeformParams) -> dict[str, Any]:
    """Return what was written and means something: a default that no preset changes is as good as left out."""
    from meshdeform.requests.parameters import FROM_PRESET, DeformParams

    usual = {name: field.default for name, field in DeformParams.model_fields.items() if name not in FROM_PRESET}
    return {n: v for n, v in params.model_dump(mode="json").items() if n not in usual or v != usual[n]}


def _names(
    found: Mapping[str, tuple[Wish, JobRequest]], known: Mapping[str, str], *, with_seed: bool
) -> dict[str, str]:
    names = {key: known[key] for key in found if key in known}
    taken = {name.casefold() for name in known.values()}
    for key, (wish, request) in found.items():
        if key in names:
            continue
        base = wish.name or f"{_slug(wish.asset.stem)}-{_slug(_words(wish, request))}"
        if with_seed and "seed" not in wish.params:
            base += f"-seed{request.params.seed}"
        # With its digest a name stays the same whatever else joins the manifest.
        name = base if base.casefold() not in taken else f"{base}-{key[:8]}"
        names[key] = name
        taken.add(name.casefold())
    return names


def _words(wish: Wish, request: JobRequest) -> str:
    return request.prompt or (f"like {wish.target.stem}" if wish.target else "")


def _slug(text: str) -> str:
    return re.sub(r"\W+", "-", text).strip("-_")[:48].strip("-_") or "x"
