"""`meshdeform inspect --parts-glb`: write an asset with its parts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.local import check_free, write_all
from meshdeform.cli.options import option
from meshdeform.cli.output import plain
from meshdeform.requests.choices import PartsAs

if TYPE_CHECKING:
    from meshdeform.assets import Asset
    from meshdeform.requests.document import ResolvedParams
    from meshdeform.runs.reading import ReadingSource

PartsGlbOption = Annotated[Path | None, option("Also write the asset with its parts to this .glb.", dir_okay=False)]
PartsAsOption = Annotated[
    PartsAs, option("How --parts-glb has them: the vertex attribute _PART, materials, or child nodes.")
]


def check_parts_glb(output: Path | None, source: Path, *, force: bool) -> None:
    """Refuse a file that is no GLB, that is the asset, or unless with `force` that exists."""
    if output is None:
        return
    if output.suffix.lower() != ".glb":
        raise typer.BadParameter(f"{output.name} does not end in .glb", param_hint="--parts-glb")
    check_free([output], [source], force=force)


def write_parts_glb(output: Path, asset: Asset, form: PartsAs, params: ResolvedParams, source: ReadingSource) -> str:
    """Write the file, and return a line that says which parts it has.

    `params`: correct the parts; `source`: the file of the asset. Raises PartNotFoundError: no part was found.
    """
    from meshdeform.plain.body import loose_body
    from meshdeform.runs.parted import parts_glb
    from meshdeform.runs.reading import corrected

    data, names = parts_glb(asset, form, corrected(loose_body(asset), asset, params, source), params)
    write_all({output: data}, what=output)
    return plain(f"{output} has {len(names)} part{'s' * (len(names) > 1)} as {form.value}: {', '.join(names)}.")
