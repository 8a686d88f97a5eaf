"""`meshdeform variants`: variations of one prompt, each at several strengths, on one contact sheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import of_kind, overlaid, with_options
from meshdeform.cli.local import LocalJob, read_asset, write_all
from meshdeform.cli.options import (
    MAX_STRENGTH,
    ForceOption,
    QuietOption,
    SetOption,
    file_argument,
    file_option,
    option,
    output_option,
)
from meshdeform.cli.output import note, show_progress
from meshdeform.cli.request import make_request, merge_params
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.assets import Asset
    from meshdeform.rendering.studio import Pose
    from meshdeform.requests.document import JobRequest
    from meshdeform.settings import Settings

_SHEET = "variants.png"


@clean_errors
@with_options(of_kind("text_deform", hidden=("seed",)))
def variants(
    ctx: typer.Context,
    asset: Annotated[Path, file_argument("The GLB, OBJ, PLY, STL or ZIP.")],
    prompt: Annotated[str, typer.Argument(help='What the asset should become, e.g. "a mushroom".')] = "",
    seeds: Annotated[str, option("Seeds, separated by commas: a run for each.")] = "0,1,2",
    strengths: Annotated[str, option("Strengths, separated by commas.")] = "0.5,1,1.5",
    output: Annotated[Path, output_option("The folder for the results and the sheet.", file_okay=False)] = Path(
        "variants"
    ),
    target: Annotated[Path | None, file_option("A mesh to deform towards, instead of a prompt.")] = None,
    param: SetOption = None,
    force: ForceOption = False,
    quiet: QuietOption = False,
) -> None:
    """Deform ASSET once for each seed, write each strength, and draw all of them on one sheet.

    With the builtin model, the first has the prompt as it is, each further one an attribute more, such as "tall".

    meshdeform variants examples/sphere.glb "a mushroom" --seeds 1,2,3 --strengths 0.5,1,1.3 -o mushrooms
    """
    require("torch", "deform")
    numbers = _numbers(seeds, "--seeds", whole=True)
    wanted = _numbers(strengths, "--strengths", whole=False)
    if not all(0 <= strength <= MAX_STRENGTH for strength in wanted):
        raise typer.BadParameter(f"strengths are from 0 to {MAX_STRENGTH:g}", param_hint="--strengths")
    if output.exists() and any(output.iterdir()) and not force:
        raise ParameterError(
            f"{output} is not empty.", advice="Choose another folder with -o, or overwrite files with --force."
        )
    settings = load_settings()
    guidance = "target" if target else None
    given = overlaid({"preset": "preview"}, merge_params(ctx, param, guidance=guidance))
    requests = {
        int(seed): make_request(text, {**given, "seed": int(seed)})
        for seed, text in zip(
            numbers, _prompts(prompt, len(numbers), given.get("guidance", {}).get("model")), strict=True
        )
    }
    paths = _made(asset, target, requests, wanted, output, settings, quiet=quiet)
    if not quiet:
        typer.echo("\n".join(map(str, paths)))


def _prompts(prompt: str, count: int, model: str | None) -> list[str]:
    """Return the prompt of each variation: the same one without a prompt, or for a model with other words."""
    from meshdeform.priors.builtin.grammar import variations
    from meshdeform.requests.document import BUILTIN_MODEL

    return variations(prompt, count) if prompt and model in (None, BUILTIN_MODEL) else [prompt] * count


def _numbers(text: str, option: str, *, whole: bool) -> list[float]:
    """Parse distinct numbers separated by commas."""
    try:
        found = [int(part) if whole else float(part) for part in text.split(",") if part.strip()]
    except ValueError:
        found = []
    if not found:
        raise typer.BadParameter(f"{text!r} is not a list of numbers, such as 1,2,3", param_hint=option)
    return list(dict.fromkeys(found))


def _made(
    asset: Path,
    target: Path | None,
    requests: dict[int, JobRequest],
    strengths: list[float],
    folder: Path,
    settings: Settings,
    *,
    quiet: bool,
) -> list[Path]:
    """Run each seed, write its strengths and the sheet, and return the paths."""
    from meshdeform.assets import Limits
    from meshdeform.rendering.studio import variant_sheet

    source = read_asset(asset, Limits.from_settings(settings))
    paths, rows = [], []
    for seed, request in requests.items():
        note(f"Seed {seed}: {request.prompt}" if request.prompt else f"Seed {seed}", quiet=quiet)
        names = ("result.glb", "report.json", "preview.png")
        outputs = {name: folder / f"seed{seed}" / name for name in names}
        inputs = {"asset": asset, **({"target": target} if target else {})}
        with show_progress(quiet=quiet) as progress:
            LocalJob(request, inputs, outputs, settings).run(progress)
        files, row = _strengths(source, outputs["result.glb"], strengths, request.params.control.exclude)
        write_all(files)
        paths += list(files)
        rows.append(row)
    titles = [f"strength {strength:g}" for strength in strengths]
    sheet = variant_sheet(
        source.appearance(), rows, [request.prompt or f"seed {seed}" for seed, request in requests.items()], titles
    )
    write_all({folder / _SHEET: sheet})
    return [*paths, folder / _SHEET]


def _strengths(
    source: Asset, result: Path, strengths: list[float], exclude: Sequence[str | int]
) -> tuple[dict[Path, bytes], list[Pose]]:
    """Return the files of a result's strengths, and how they look."""
    from meshdeform.rendering.studio import Pose
    from meshdeform.runs.strength import with_strength
    from meshdeform.runs.surfaces import read_result

    data = result.read_bytes()
    files = {
        result.with_name(f"strength{100 * strength:g}.glb"): with_strength(source, data, strength, exclude=exclude)
        for strength in strengths
    }
    surfaces = [read_result(made).surface for made in files.values()]
    return files, [Pose(surface.positions, surface.normals) for surface in surfaces]
