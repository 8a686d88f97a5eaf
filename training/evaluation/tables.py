"""Format summaries as Markdown tables that are also readable in a terminal."""

from __future__ import annotations

from typing import Any

_COLUMNS = (
    "results",
    "retrieval",
    "noun",
    "CLIP",
    "p(prompt)",
    "flipped",
    "any flipped",
    "any collapsed",
    "cut",
    "any cut",
    "angle p1",
    "SD mean",
    "SD p99",
    "area spread",
    "volume",
    "moved",
    "distance",
    "apart",
    "most apart",
    "stretch",
)


def table(first: str, rows: list[tuple[str, dict[str, Any]]], title: str = "") -> str:
    """Return a Markdown table of summaries (`summary.summarise`), one per row; `first` heads the names."""
    cells = [[name, *_cells(summary)] for name, summary in rows]
    return _markdown([first, *_COLUMNS], cells, title)


def comparison(results: list[tuple[str, dict[str, Any]]]) -> str:
    """Return one table of several runs (`results.json` documents by name): a row per run and number of steps."""
    cells = [
        [name, document["manifest"]["suite"], str(row["steps"]), str(document["failed"]), *_cells(row["overall"])]
        for name, document in results
        for row in document["summary"]
    ]
    return _markdown(["run", "suite", "steps", "failed", *_COLUMNS], cells)


_KEPT_COLUMNS = (
    "results",
    "noun first",
    "stretched",
    "source",
    "gained",
    "asymmetry",
    "flatness",
    "contacts",
    "cut",
    "flipped",
    "worse than source",
)


def kept_table(rows: list[tuple[str, dict[str, Any]]]) -> str:
    """Return a Markdown table of what results kept (`summary.summarise_kept`), a row for each run or source."""
    return _markdown(["of", *_KEPT_COLUMNS], [[name, *_kept_cells(row)] for name, row in rows], "Kept")


def _kept_cells(row: dict[str, Any]) -> list[str]:
    first, structure = row["noun_first"], row["structure"]
    of_100 = [f"{_of_100(structure[name])}" for name in ("asymmetry", "flatness", "contacts", "cut_share")]
    flipped = f"{structure['flipped_faces']['mean']:.1f} ({structure['flipped_faces']['most']})"
    judged = ["-"] * 4 if first is None else [*(_percent(first[who]) for who in ("result", "stretch", "source")),
                                              _percent(row["gained"])]  # fmt: skip
    worse = "-" if row["worse_share"] is None else _percent(row["worse_share"])
    return [str(row["count"]), *judged, *of_100, flipped, worse]


def _of_100(figure: dict[str, float] | None) -> str:
    return "-" if figure is None else f"{100 * figure['mean']:.2f} % ({100 * figure['most']:.1f})"


def _markdown(header: list[str], rows: list[list[str]], title: str = "") -> str:
    widths = [max(len(row[k]) for row in [header, *rows]) for k in range(len(header))]
    lines = ["| " + " | ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)) + " |"
             for row in [header, *rows]]  # fmt: skip
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return (f"## {title}\n\n" if title else "") + "\n".join(lines) + "\n"


def _cells(row: dict[str, Any]) -> list[str]:
    if not row["count"]:
        return ["0", *["-"] * (len(_COLUMNS) - 1)]
    return [
        str(row["count"]),
        _interval(row["retrieval"]),
        _interval(row["noun_retrieval"]),
        _interval(row["clip_retrieval"]),
        "-" if row["probability_mean"] is None else f"{row['probability_mean']:.2f}",
        f"{row['flipped_faces_mean']:.1f}",
        _percent(row["flipped_share"]),
        _percent(row["collapsed_share"]),
        f"{row['self_intersections_added_mean']:.1f}",
        _percent(row["self_intersections_share"]),
        f"{row['min_angle_p1_deg_mean']:.1f}",
        f"{row['symmetric_dirichlet_mean']:.2f}",
        f"{row['symmetric_dirichlet_p99_median']:.1f}",
        f"{row['area_ratio_spread_mean']:.2f}",
        f"{row['volume_ratio_mean']:.2f}",
        f"{row['displacement_mean']:.3f}",
        f"{row['chamfer_mean']:.3f}",
        f"{100 * row['neighbour_offset_mean']:.1f} %",
        f"{100 * row['neighbour_offset_max']:.1f} %",
        # Folders of an earlier edition have no such figure.
        "-" if row.get("texture_stretch_p95_mean") is None else f"{row['texture_stretch_p95_mean']:.2f}",
    ]


def _interval(share: dict[str, float] | None) -> str:
    if share is None:
        return "-"
    return f"{_percent(share['share'])} ({100 * share['low']:.0f}-{100 * share['high']:.0f})"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
