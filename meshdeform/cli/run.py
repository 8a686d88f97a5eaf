"""`meshdeform run`: deform one asset on this machine, without a server."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from meshdeform.cli.animate import check_animation, write_animation
from meshdeform.cli.control import parse_handles, parse_regions, parse_rigid
from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.fit import fit_line
from meshdeform.cli.goals import parse_goals
from meshdeform.cli.likeness import kept_line, likeness_line, verdict_line
from meshdeform.cli.options import (
    AlsoOption,
    ExcludeOption,
    HandleOption,
    JsonOption,
    KeepOption,
    ModelOption,
    MorphPathOption,
    OnlyOption,
    QuietOption,
    RigidOption,
    RigOption,
    SetOption,
    SilhouetteOption,
    SymmetryOption,
)
from meshdeform.cli.orientation import orientation_line, source_line
from meshdeform.cli.output import emit
from meshdeform.cli.overwriting import check_checkpoint, check_outputs
from meshdeform.cli.prompts import parse_also, prompt_lines
from meshdeform.cli.request import find_taught, make_request, merge_params, parse_exclude, parse_morph_path
from meshdeform.cli.silhouettes import parse_pictures, silhouettes_line
from meshdeform.cli.sketch import write_sketched_target
from meshdeform.cli.texture_stretch import stretch_line
from meshdeform.requests.choices import Preset
from meshdeform.support.collector import collection_paused

__all__ = ["run"]

_OUTPUTS, _METHOD, _RESUME = "Outputs", "Method", "Interrupt and resume"


def _file(text: str, panel: str, *, exists: bool = False) -> Any:
    return typer.Option(help=text, rich_help_panel=panel, dir_okay=False, exists=exists, show_default=False)


@clean_errors
def run(
    asset: Annotated[
        Path,
        typer.Argument(
            help="The GLB, OBJ, PLY, STL or ZIP; or points (PLY, XYZ), a distance grid (NPZ), a network (safetensors).",
            exists=True,
            dir_okay=False,
            readable=True,
        ),
    ],
    prompt: Annotated[
        str,
        typer.Argument(help='What the asset should become: "a mushroom". Or --also, --target or --silhouette.'),
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="The GLB to write. Default: ASSET-deformed.glb in this folder.", show_default=False
        ),
    ] = None,
    report: Annotated[Path | None, _file("Where the report goes (default: beside the GLB).", _OUTPUTS)] = None,
    preview: Annotated[Path | None, _file("Where the picture goes (default: beside the GLB).", _OUTPUTS)] = None,
    morph: Annotated[
        bool,
        typer.Option(help="Also write a GLB that animates from the source to the result.", rich_help_panel=_OUTPUTS),
    ] = False,
    morph_path: MorphPathOption = None,
    subdivide: Annotated[
        bool,
        typer.Option(
            "--subdivide", help="Split long edges first, so that large triangles can bend.", rich_help_panel=_OUTPUTS
        ),
    ] = False,
    compact: Annotated[
        bool,
        typer.Option("--compact", help="Drop data that the new shape made unused.", rich_help_panel=_OUTPUTS),
    ] = False,
    provenance: Annotated[
        bool,
        typer.Option("--provenance", help="Store prompt, seed and source in the GLB.", rich_help_panel=_OUTPUTS),
    ] = False,
    animate: Annotated[
        Path | None, _file("Also draw source to result and back, as this .webp or .gif.", _OUTPUTS)
    ] = None,
    force: Annotated[
        bool,
        typer.Option("--force", help="Overwrite files that no earlier run wrote.", rich_help_panel=_OUTPUTS),
    ] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    preset: Annotated[
        Preset | None,
        typer.Option(
            help="Quality: preview (fast), balanced (the default) or paper (slow).",
            rich_help_panel=_METHOD,
            show_default=False,
        ),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="Optimiser iterations; default: the preset's.", rich_help_panel=_METHOD)
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="Random seed: another seed gives another variation; default: 0.", rich_help_panel=_METHOD),
    ] = None,
    model: ModelOption = None,
    orientation: Annotated[
        str | None,
        typer.Option(
            help="Which side of the asset becomes the front: auto, keep or degrees from +Z towards +X.",
            rich_help_panel=_METHOD,
        ),
    ] = None,
    guidance_scale: Annotated[
        float | None,
        typer.Option(help="How strongly the prompt pulls (classifier-free guidance).", rich_help_panel=_METHOD),
    ] = None,
    learning_rate: Annotated[
        float | None, typer.Option(help="How far one step may go (Adam's step size).", rich_help_panel=_METHOD)
    ] = None,
    target: Annotated[
        Path | None, _file("A mesh to deform towards, instead of a prompt.", _METHOD, exists=True)
    ] = None,
    sketch: Annotated[
        Path | None,
        _file(
            "A line drawing (PNG, JPEG or WebP) whose first guess is the target, as in meshdeform sketch.",
            _METHOD,
            exists=True,
        ),
    ] = None,
    also: AlsoOption = None,
    silhouette: SilhouetteOption = None,
    exclude: ExcludeOption = None,
    rigid: RigidOption = None,
    keep: KeepOption = None,
    only: OnlyOption = None,
    handle: HandleOption = None,
    symmetry: SymmetryOption = None,
    rig: RigOption = None,
    param: SetOption = None,
    device: Annotated[str | None, typer.Option(help="auto, cpu, cuda or cuda:N.", rich_help_panel=_METHOD)] = None,
    threads: Annotated[
        int | None, typer.Option(min=0, help="CPU threads; 0: all cores.", rich_help_panel=_METHOD)
    ] = None,
    checkpoint: Annotated[Path | None, _file("Save the state to this file regularly and at Ctrl-C.", _RESUME)] = None,
    resume: Annotated[Path | None, _file("Continue from a file that --checkpoint wrote.", _RESUME, exists=True)] = None,
) -> None:
    """Deform ASSET until it looks like PROMPT, on this machine.

    meshdeform run examples/sphere.glb "a mushroom" -o mushroom.glb

    meshdeform run examples/sphere.glb --target examples/vase.glb --set laplacian_weight=0.3
    """
    require("torch", "deform")
    settings = load_settings(device=device, threads=threads)
    output = output or Path(f"{asset.stem}-deformed.glb")
    if output.suffix.lower() != ".glb":
        raise typer.BadParameter(f"the result is a GLB, but {output.name} does not end in .glb", param_hint="--output")
    if animate is not None:
        check_animation(animate, "--animate")
    goals = parse_goals(target, sketch, output)
    pictures = parse_pictures(silhouette)
    if silhouette and not (prompt or also) and not goals.params:
        goals.params["guidance"] = "silhouettes"
    params = merge_params(
        param or [],
        preset=preset,
        **goals.params,
        silhouettes=pictures.views or None,
        model=model,
        steps=steps,
        seed=seed,
        orientation=orientation,
        guidance_scale=guidance_scale,
        learning_rate=learning_rate,
        exclude=parse_exclude(exclude),
        rigid=parse_rigid(rigid),
        regions=parse_regions(keep, only),
        prompts=parse_also(also),
        handles=parse_handles(handle),
        symmetry=symmetry,
    )
    morph = morph or bool(morph_path)
    written: dict[str, Any] = {"morph": morph, "morph_path": parse_morph_path(morph_path)}
    written |= {"compact": compact, "subdivide": subdivide, "provenance": provenance, "rig": rig}
    request = find_taught(make_request(prompt, params, output=written), settings)
    paths = {
        "result": output,
        "report": report or output.with_suffix(".report.json"),
        "preview": preview or output.with_suffix(".preview.png"),
        **({"morph": output.with_suffix(".morph.glb")} if morph else {}),
    }
    if not force:
        drawn = {"animation": animate} if animate else {}
        check_outputs(
            {**paths, **drawn}, [path for path in (asset, *goals.files.values(), resume, *pictures.paths) if path]
        )
        if checkpoint is not None:
            check_checkpoint(checkpoint)
    from meshdeform.runs import text_deform_checks

    # Refuse unknown words at once, before torch is imported, which takes seconds.
    text_deform_checks.check(
        request,
        default_model=settings.model,
        allowed_models=[request.params.model] if request.params.model else [],
        revision=settings.model_revision,
        has_target="target" in goals.files,
        pictures=pictures.parts,
    )
    with collection_paused(keep=True):
        from meshdeform.cli.local_job import LocalJob, Outputs
    from meshdeform.cli.progress import show_progress

    sketched = write_sketched_target(sketch, goals.files["target"]) if sketch else None
    outputs = Outputs(**paths, checkpoint=checkpoint)
    target = goals.files.get("target")
    job = LocalJob(asset, request, settings, outputs, target=target, pictures=pictures.paths, resume=resume)
    with show_progress(quiet=quiet) as progress:
        summary = job.run(progress)
        if animate is not None:
            write_animation(job.source, output, animate, settings)
    if sketched is not None:
        summary["targets"].append(str(goals.files["target"]))
    summary["sketch"] = sketched
    summary["animation"] = str(animate) if animate else None
    if as_json:
        emit(summary)
        return
    if quiet:
        return
    names = {"result": "GLB", "morph": "Morph GLB", "report": "Report", "preview": "Picture"}
    names["animation"] = "Animation"
    names["source"] = "Source mesh"
    if sketched is not None:
        typer.echo(f"{'Drawing':<10} {sketched}: {goals.files['target']}")
    for name, title in names.items():
        if summary[name] is not None:
            typer.echo(f"{title:<10} {summary[name]}")
    for line in filter(None, (source_line(summary), orientation_line(summary["orientation"]))):
        typer.echo(line)
    if summary["appearance"]["notice"]:
        typer.echo(summary["appearance"]["notice"])
    if summary["prompts"] is not None:
        for line in prompt_lines(summary["prompts"]):
            typer.echo(line)
    elif summary["likeness"] is not None:
        typer.echo(likeness_line(summary["likeness"]))
    typer.echo(kept_line(summary["posed_quality"] or summary["quality"]))
    if summary["verdict"] is not None and (verdict := verdict_line(summary["verdict"])):
        typer.echo(verdict)
    if summary["texture_stretch"] is not None:
        typer.echo(stretch_line(summary["texture_stretch"]))
    if summary["fit"] is not None:
        typer.echo(fit_line(summary["fit"]))
    if summary["silhouettes"] is not None:
        typer.echo(silhouettes_line(summary["silhouettes"]))
    for warning in summary["warnings"]:
        typer.echo(warning, err=True)
