"""Write the results of one asset as morph targets of one file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.bundle import read_with_files
from meshdeform.assets.morph import MorphTarget
from meshdeform.cli.batches.rows import Row
from meshdeform.errors import UnavailableError
from meshdeform.runs.strength import check_same_asset, matched
from meshdeform.runs.text_report import read_result
from meshdeform.support.files import write_files

__all__ = ["write_target_sets"]


def write_target_sets(folder: Path, rows: Sequence[Row], limits: Limits) -> list[Path]:
    """Write, for each asset, the source with its results as morph targets, named after their rows and of weight 0.

    Parameters
    ----------
    folder : Path
        The folder of the batch.
    rows : sequence of Row
        Those without a result are left out.
    limits : Limits

    Returns
    -------
    list of Path
        `ASSET.targets.glb` of each asset, in the order of the rows.

    Raises
    ------
    ParameterError
        Rows of one asset differ in `params.exclude` or `output.subdivide`.
    UnavailableError
        A file cannot be written.
    """
    by_asset: dict[Path, list[Row]] = {}
    for row in rows:
        if row.path(folder, "result.glb").exists():
            by_asset.setdefault(row.asset.absolute(), []).append(row)
    files: dict[Path, bytes] = {}
    for asset, own in by_asset.items():
        path = folder / f"{asset.stem}.targets.glb"
        number = 2
        while path in files:  # assets of different folders may have the same name
            path, number = folder / f"{asset.stem}-{number}.targets.glb", number + 1
        source = load_asset(read_with_files(asset, limits), asset.name, limits)
        pairs = [_read(source, row, folder, limits) for row in own]
        base = pairs[0][0]
        for row, (_, result) in zip(own, pairs, strict=True):
            check_same_asset(base, result, (own[0].name, row.name))
        shapes = [(row.name, result.surface) for row, (_, result) in zip(own, pairs, strict=True)]
        targets = [MorphTarget(name, s.positions, s.normals, s.tangents) for name, s in shapes]
        files[path] = base.morph(targets, weights=[0.0] * len(targets))
    try:
        write_files(files)
    except OSError as error:
        raise UnavailableError(
            f"The morph targets cannot be written: {error}.", advice="Free some space, then run the same command again."
        ) from error
    return list(files)


def _read(source: Asset, row: Row, folder: Path, limits: Limits) -> tuple[Asset, Asset]:
    """Return the source as a row deformed it, and the row's result."""
    result = read_result(row.path(folder, "result.glb").read_bytes())
    return matched(source, result, row.request.params.exclude, limits)
