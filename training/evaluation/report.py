"""Judge the results of a run, and write its report: `results.json` and `table.md`, all from the files in its folder."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

from meshdeform.assets import Limits, load_asset
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.weld import weld
from meshdeform.support.files import write_files
from training.evaluation.clip_judge import ClipJudge
from training.evaluation.retrieval import ShapeJudge, judgement

_COLUMNS = (
    *("results", "retrieval", "noun", "CLIP", "good", "keep source"),
    *("any flipped", "any cut", "SD mean", "SD p99", "kept"),
)

Rows = list[dict[str, Any]]


def write_report(
    folder: Path, manifest: dict[str, Any], judge: ShapeJudge | None, clip: ClipJudge | None
) -> dict[str, Any]:
    """Judge every result in a folder, and write the two files.

    Returns
    -------
    dict
        `manifest`, with the identities of the judges; `rows`: of each deformation its row of `meshdeform batch` with
        `quality` by its report, `judge` and `clip` (`judgement` of each); `summary` of all (`summarise`).
    """
    rows = json.loads((folder / "summary.json").read_text())["rows_detail"]
    for row in rows:
        done = row["state"] == "succeeded"
        row["quality"] = json.loads((folder / row["name"] / "report.json").read_text())["quality"] if done else None
        mesh = _mesh(folder / row["name"] / "result.glb") if done else None
        row["judge"] = judgement(judge, mesh, manifest["prompts"], row["prompt"]) if judge and mesh else None
        row["clip"] = clip.judgement(mesh, manifest["prompts"], row["prompt"]) if clip and mesh else None
    identities = {"judge": dict(judge.identity) if judge else None, "clip": clip.identity if clip else None}
    document = {"manifest": {**manifest, **identities}, "rows": rows, "summary": summarise(rows)}
    pages = {"results.json": json.dumps(document, indent=1) + "\n", "table.md": _page(document)}
    write_files({folder / name: text.encode() for name, text in pages.items()})
    return document


def summarise(rows: Rows) -> dict[str, Any]:
    """Compute one row of a table.

    Returns
    -------
    dict
        `count` and `failed` results; `retrieval`, `noun` and `clip` (`hits`, `count`, `share`, `low`, `high`: the 95 %
        interval) or None if nothing was judged; the shares of each verdict, and of results with any newly flipped or
        cutting face; means of the measures, but of the energies' 99th percentiles the median, since a single collapsed
        face would dominate their mean.
    """
    good = [row for row in rows if row["state"] == "succeeded"]
    counts = {"count": len(good), "failed": sum(row["state"] not in ("succeeded", "pending") for row in rows)}
    if not good:
        return counts

    def of(name: str) -> list[float]:
        return [row["quality"][name] for row in good if row["quality"][name] is not None]

    def any_share(name: str) -> float | None:
        return statistics.fmean(value > 0 for value in of(name)) if of(name) else None

    return {
        **counts,
        "retrieval": _share(good, "judge", "hit"),
        "noun": _share(good, "judge", "noun_hit"),
        "clip": _share(good, "clip", "hit"),
        **{value: statistics.fmean(row["verdict"] == value for row in good) for value in ("good", "keep_source")},
        "any_flipped": any_share("flipped_faces"),
        "any_cut": any_share("self_intersections_added"),
        "symmetric_dirichlet_mean": statistics.fmean(of("symmetric_dirichlet_mean")),
        "symmetric_dirichlet_p99": statistics.median(of("symmetric_dirichlet_p99")),
        "kept_share": statistics.fmean(of("kept_share")),
    }


def compare(folders: list[Path]) -> str:
    """Return one table of several runs.

    Raises
    ------
    ParameterError
        A folder has no results.
    """
    lines = {}
    for folder in folders:
        try:
            document = json.loads((folder / "results.json").read_text())
        except (OSError, ValueError) as error:
            raise ParameterError(
                f"{folder} has no results: {error}.", advice="Name folders of finished runs."
            ) from error
        lines[f"{folder.name}: {document['manifest']['suite']}, {document['manifest']['kind']}"] = document["summary"]
    return table("run", lines)


def table(first: str, summaries: dict[str, dict[str, Any]]) -> str:
    """Return a Markdown table of summaries (`summarise`) by name; `first` heads the names."""
    cells = [[first, *_COLUMNS], *([name, *_cells(row)] for name, row in summaries.items())]
    widths = [max(len(row[k]) for row in cells) for k in range(len(cells[0]))]
    lines = [" | ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)) for row in cells]
    lines.insert(1, " | ".join("-" * width for width in widths))
    return "".join(f"| {line} |\n" for line in lines)


def _mesh(path: Path) -> TriangleMesh:
    surface = load_asset(path.read_bytes(), path.name, Limits.unlimited()).surface
    return weld(surface.positions, surface.triangles).mesh


def _share(rows: Rows, who: str, hit: str) -> dict[str, float] | None:
    judged = [bool(row[who][hit]) for row in rows if row[who]]
    if not judged:
        return None
    low, high = interval(sum(judged), len(judged))
    return {"hits": sum(judged), "count": len(judged), "share": sum(judged) / len(judged), "low": low, "high": high}


def _page(document: dict[str, Any]) -> str:
    manifest, rows = document["manifest"], document["rows"]

    def by(name: Callable[[dict[str, Any]], str]) -> dict[str, dict[str, Any]]:
        names = dict.fromkeys(map(name, rows))
        return {each: summarise([row for row in rows if name(row) == each]) for each in names}

    judge, clip = (manifest[who]["id"] if manifest[who] else "none" for who in ("judge", "clip"))
    missed = [row for row in rows if row["judge"] and not row["judge"]["hit"]]
    failed = [row for row in rows if row["error"]]
    return "\n".join(
        [
            f"# Suite `{manifest['suite']}`, guidance `{manifest['kind']}`\n",
            f"Judge: {judge}; CLIP: {clip}. Retrieval with its 95 % interval; docs/quality.md defines every column.\n",
            table("", {"all": document["summary"]}),
            table("prompt", by(lambda row: str(row["prompt"]))),
            table("source", by(lambda row: Path(row["asset"]).stem)),
            *(f"- {row['name']}: taken for {row['judge']['retrieved']}" for row in missed),
            *(f"- {row['name']} failed: {row['error']}" for row in failed),
        ]
    )


def _cells(row: dict[str, Any]) -> list[str]:
    if not row["count"]:
        return ["0", *["-"] * (len(_COLUMNS) - 1)]
    return [
        str(row["count"]),
        *(_interval(row[who]) for who in ("retrieval", "noun", "clip")),
        *(_percent(row[name]) for name in ("good", "keep_source", "any_flipped", "any_cut")),
        f"{row['symmetric_dirichlet_mean']:.2f}",
        f"{row['symmetric_dirichlet_p99']:.1f}",
        _percent(row["kept_share"]),
    ]


def interval(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    z = 1.96
    share = hits / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return max(0.0, middle - half), min(1.0, middle + half)


def _interval(share: dict[str, float] | None) -> str:
    if share is None:
        return "-"
    return f"{_percent(share['share'])} ({100 * share['low']:.0f}-{100 * share['high']:.0f})"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f} %"
