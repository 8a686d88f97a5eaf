"""`python -m training.evaluation`: run the benchmark and compare its results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.options import JsonOption, QuietOption
from meshdeform.cli.output import emit, note
from meshdeform.cli.request import make_settings
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.settings import Settings
    from training.evaluation.plan import Plan
    from training.evaluation.suite import Suite

__all__ = ["app", "evaluate"]

_METHOD, _JUDGES, _RUN, _AFTER = "Method", "Judges", "Running", "Finished runs"


@clean_errors
def evaluate(
    folders: Annotated[
        list[Path] | None, typer.Argument(help="With --compare: the folders of finished runs.", show_default=False)
    ] = None,
    suite: Annotated[
        str,
        typer.Option(
            help="small, full, turned, nouns, unseen, seen, assets, turned-assets, held-out-packs, keep or paper."
        ),
    ] = "small",
    out: Annotated[
        Path, typer.Option(help="The folder of the run; the same command resumes in it.", file_okay=False)
    ] = Path("meshdeform-eval"),
    preset: Annotated[
        str | None,
        typer.Option(help="Quality: preview, balanced or paper; default: the suite's.", rich_help_panel=_METHOD),
    ] = None,
    settings_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Any parameter (docs/parameters.md); repeatable.",
            rich_help_panel=_METHOD,
        ),
    ] = None,
    ablation: Annotated[
        str | None,
        typer.Option(
            help="Remove a part of the method: vertices, single_views, no_jacobian, no_laplacian or no_normal "
            "(docs/quality.md).",
            rich_help_panel=_METHOD,
        ),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="Optimiser iterations; default: the preset's.", rich_help_panel=_METHOD)
    ] = None,
    checkpoint_at: Annotated[
        list[int] | None,
        typer.Option(help="Also judge the shape after this many steps; repeatable.", min=1, rich_help_panel=_METHOD),
    ] = None,
    prior: Annotated[
        str, typer.Option(help="builtin, or sd for a Stable Diffusion model.", rich_help_panel=_METHOD)
    ] = "builtin",
    model: Annotated[
        str | None,
        typer.Option(
            help="With --prior sd: hub id or folder; otherwise: a file of meshdeform teach.", rich_help_panel=_METHOD
        ),
    ] = None,
    seeds: Annotated[
        str | None, typer.Option(help="Instead of the suite's, e.g. 0,1,2.", rich_help_panel=_METHOD)
    ] = None,
    source: Annotated[
        list[Path] | None,
        typer.Option(
            help="A mesh of your own (GLB, OBJ, PLY, STL) in place of the suite's; repeatable.",
            rich_help_panel=_METHOD,
            exists=True,
            dir_okay=False,
        ),
    ] = None,
    assets: Annotated[
        Path | None,
        typer.Option(
            help="With a suite of real assets: a folder with its files.",
            rich_help_panel=_METHOD,
            exists=True,
            file_okay=False,
            show_default=False,
        ),
    ] = None,
    judge: Annotated[
        str, typer.Option(help="builtin, none, or package.module:name.", rich_help_panel=_JUDGES)
    ] = "builtin",
    clip: Annotated[
        Path | None,
        typer.Option(
            help="Folder of a CLIP model, for CLIP R-precision.",
            exists=True,
            file_okay=False,
            rich_help_panel=_JUDGES,
            show_default=False,
        ),
    ] = None,
    device: Annotated[str | None, typer.Option(help="auto, cpu, cuda or cuda:N.", rich_help_panel=_RUN)] = None,
    jobs: Annotated[
        int | None,
        typer.Option(help="Processes; default: one per core, one in all with --prior sd.", min=1, rich_help_panel=_RUN),
    ] = None,
    limit: Annotated[
        int | None, typer.Option(help="Only the first this many deformations.", min=1, rich_help_panel=_RUN)
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only list the deformations.", rich_help_panel=_RUN)
    ] = False,
    rejudge: Annotated[
        bool, typer.Option("--rejudge", help="Judge the meshes in --out again.", rich_help_panel=_AFTER)
    ] = False,
    compare: Annotated[
        bool, typer.Option("--compare", help="Print one table of several finished runs.", rich_help_panel=_AFTER)
    ] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run the benchmark, or compare its results.

    Deforms many meshes by many prompts; reports how many show their prompt, and the quality of the meshes.

    python -m training.evaluation --suite small --out eval-small

    python -m training.evaluation --compare eval-small eval-few
    """
    require("torch", "deform")
    if compare:
        _compare(_given(folders), as_json=as_json)
        return
    if folders:
        raise typer.BadParameter("folders are only for --compare", param_hint="FOLDERS")
    settings = load_settings(device=device, model=model)
    options = {**_set(settings_ or []), "steps": steps, "preset": preset}

    def plan() -> Plan:
        chosen = _suite(suite, tuple(str(path) for path in source or []), assets, seeds)
        return _plan(
            chosen, out, options, checkpoint_at or [], _model(prior, model, settings), settings, judge, clip, ablation
        )

    if dry_run:
        _list(plan(), limit, as_json)
        return
    from training.evaluation import runner
    from training.evaluation.summary import outweighed
    from training.evaluation.tables import table

    def print_line(line: str) -> None:
        note(line, quiet=quiet)

    try:
        if rejudge:
            document = runner.rejudge(_kept_plan(out, settings, judge, clip), say=print_line)
        else:
            plan_wanted = plan()
            document = runner.run(
                plan_wanted, jobs=jobs or runner.default_jobs(plan_wanted), limit=limit, say=print_line
            )
    except KeyboardInterrupt:
        raise OutcomeError(
            ExitCode.INTERRUPTED, "interrupted", "Interrupted.", f"The same command resumes in {out}."
        ) from None
    if as_json:
        emit(_outcome(out, document))
        return
    typer.echo(table("steps", [(str(row["steps"]), row["overall"]) for row in document["summary"]]), nl=False)
    typer.echo(f"{document['done']} of {document['expected']} done, {document['failed']} failed")
    typer.echo(f"{out / 'results.json'}  {out / 'table.md'}  {out / 'sheet.png'}")
    harder = outweighed(document["records"])
    if harder and not document["manifest"].get("ablation"):
        raise OutcomeError(
            ExitCode.SOME_FAILED,
            "outweighed",
            f"A regulariser pulled harder than the guidance in {len(harder)} runs: {'; '.join(harder)}.",
            "Lower its weight: the prompt is to decide.",
        )


def _list(plan: Plan, limit: int | None, as_json: bool) -> None:
    from training.evaluation.listing import listing, outline

    if as_json:
        emit(outline(plan, limit=limit))
    else:
        typer.echo(listing(plan, limit=limit), nl=False)


def _outcome(folder: Path, document: dict[str, Any]) -> dict[str, Any]:
    files = {name: str(folder / name) for name in ("results.json", "table.md", "sheet.png")}
    numbers = {name: document[name] for name in ("expected", "done", "failed", "step_s_median", "summary")}
    return {"folder": str(folder), "files": files, **numbers}


def _compare(folders: list[Path], *, as_json: bool) -> None:
    from training.evaluation.report import compare, read_results

    if as_json:
        emit({"runs": [_outcome(folder, read_results(folder)) for folder in folders]})
    else:
        typer.echo(compare(folders), nl=False)


def _given(folders: list[Path] | None) -> list[Path]:
    if not folders:
        raise typer.BadParameter("--compare needs the folders of runs", param_hint="FOLDERS")
    return folders


def _suite(name: str, sources: tuple[str, ...], assets: Path | None, seeds: str | None) -> Suite:
    from training.evaluation.suite import find_suite

    suite = find_suite(name)
    if sources:
        suite = suite.with_sources(sources)
    if assets is not None or suite.pairs:
        if assets is None:
            raise typer.BadParameter(f"the suite {name} needs a folder with its files", param_hint="--assets")
        suite = suite.in_folder(assets)
    return suite.with_seeds(_seeds(seeds)) if seeds is not None else suite


def _plan(
    suite: Suite,
    out: Path,
    options: dict[str, Any],
    checkpoint_at: list[int],
    model: str,
    settings: Settings,
    judge: str,
    clip: Path | None,
    ablation: str | None,
) -> Plan:
    from meshdeform.requests.document import resolve
    from meshdeform.requests.groups import grouped
    from meshdeform.runs.devices import resolve_device
    from training.evaluation.ablations import Ablation, ablated_params
    from training.evaluation.plan import Plan

    if ablation is not None and ablation not in list(Ablation):
        raise typer.BadParameter(f"{ablation!r} is not one of {', '.join(Ablation)}", param_hint="--ablation")
    chosen = Ablation(ablation) if ablation is not None else None
    params = resolve(_params(grouped({"preset": suite.preset, "model": model, **_without_none(options)})))
    params = ablated_params(params, chosen)
    late = [step for step in checkpoint_at if step > params.steps]
    if late:
        raise ParameterError(f"--checkpoint-at {late[0]} is after the last step, {params.steps}.")
    return Plan(
        suite=suite,
        params=params,
        steps=tuple(sorted({*checkpoint_at, params.steps})),
        folder=out,
        revision=settings.model_revision,
        device=resolve_device(settings.device),
        dtype=settings.dtype,
        judge=judge,
        clip=str(clip.resolve()) if clip else "",
        ablation=chosen,
    )


def _kept_plan(out: Path, settings: Settings, judge: str, clip: Path | None) -> Plan:
    from meshdeform.runs.devices import resolve_device
    from training.evaluation.plan import plan_of, read_manifest

    manifest = read_manifest(out)
    if manifest is None:
        raise ParameterError(f"There is no run in {out}.", advice="Name the folder of a run with --out.")
    clip_folder = str(clip.resolve()) if clip else ""
    return plan_of(out, manifest, judge=judge, clip=clip_folder, device=resolve_device(settings.device))


def _model(prior: str, choice: str | None, settings: Settings) -> str:
    from meshdeform.priors import configured_name
    from meshdeform.requests.choices import is_builtin, is_taught
    from meshdeform.requests.document import BUILTIN_MODEL, DEFAULT_SD_MODEL

    if prior == "builtin":
        if choice is not None and not is_builtin(choice):
            raise typer.BadParameter("this goes with --prior sd", param_hint="--model")
        model = choice or BUILTIN_MODEL
        if not is_taught(model) or Path(model).expanduser().exists():
            return model
        return configured_name(model, settings.offered_models)
    if prior != "sd":
        raise typer.BadParameter(f"{prior!r} is not builtin or sd", param_hint="--prior")
    return settings.model if settings.model != BUILTIN_MODEL else DEFAULT_SD_MODEL


def _params(values: dict[str, Any]) -> Any:
    from pydantic import ValidationError

    from meshdeform.requests.document import DeformParams

    try:
        return DeformParams.model_validate(values)
    except ValidationError as error:
        sentences = [f"{'.'.join(str(part) for part in e['loc'])}: {e['msg']}" for e in error.errors()]
        raise ParameterError(
            f"The parameters are not valid: {'; '.join(sentences)}.",
            advice="docs/parameters.md has every parameter with its bounds.",
        ) from error


def _without_none(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _set(pairs: list[str]) -> dict[str, Any]:
    parameters = make_settings(pairs)
    for name in {"seed", "guidance"} & parameters.keys():
        raise typer.BadParameter(f"{name} cannot be set here; use --seeds for seeds", param_hint="--set")
    return parameters


def _seeds(text: str) -> tuple[int, ...]:
    try:
        numbers = tuple(int(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a list of numbers such as 0,1,2", param_hint="--seeds") from None
    if len(set(numbers)) != len(numbers) or min(numbers) < 0:
        raise typer.BadParameter("seeds must differ and not be negative", param_hint="--seeds")
    return numbers


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
app.command(name="evaluation")(evaluate)

if __name__ == "__main__":
    app(prog_name="python -m training.evaluation")
