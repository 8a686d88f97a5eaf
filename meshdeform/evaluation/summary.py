"""Summarise records: shares with their intervals, means and worst cases of the measures."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable
from typing import Any

from meshdeform.evaluation.retrieval import wilson

__all__ = ["States", "states_of", "summarise"]

States = list[dict[str, Any]]


def states_of(records: Iterable[dict[str, Any]], steps: int) -> States:
    """Return the states after `steps` of all successful records, each with its source, prompt and seed."""
    return [
        {**state, **{name: record[name] for name in ("source", "prompt", "seed")}}
        for record in records
        for state in record["states"]
        if state["steps"] == steps
    ]


def summarise(states: States) -> dict[str, Any]:
    """Compute one row of a table.

    Returns
    -------
    dict
        `count`; `retrieval`, `noun_retrieval` and `clip_retrieval` (`hits`, `count`, `share`, `low`, `high`: the 95 %
        interval) or None if nothing was judged; the mean probability of the prompt; shares of results with any
        flipped, collapsed or newly intersecting face; means of the measures, and medians of the energies' 99th
        percentiles, whose means a single collapsed face would dominate.
    """
    if not states:
        return {"count": 0}

    def of(name: str) -> list[float]:
        # A folder of an earlier version has no figure that was added since.
        return [float(state["quality"].get(name, 0.0)) for state in states]

    def mean(name: str) -> float:
        return statistics.fmean(of(name))

    def any_share(name: str) -> float:
        return statistics.fmean(value > 0 for value in of(name))

    return {
        "count": len(states),
        "retrieval": _share(states, "judge", lambda judged: judged["hit"]),
        "noun_retrieval": _share(states, "judge", lambda judged: judged["noun_hit"]),
        "clip_retrieval": _share(states, "clip", lambda judged: judged["hit"]),
        "probability_mean": _mean(states, "judge", "probability"),
        "rank_mean": _mean(states, "judge", "rank"),
        "flipped_faces_mean": mean("flipped_faces"),
        "flipped_share": any_share("flipped_faces"),
        "collapsed_share": any_share("collapsed_faces"),
        "self_intersections_added_mean": mean("self_intersections_added"),
        "self_intersections_share": any_share("self_intersections_added"),
        "min_angle_p1_deg_mean": mean("min_angle_p1_deg_after"),
        "symmetric_dirichlet_mean": mean("symmetric_dirichlet_mean"),
        "symmetric_dirichlet_p99_median": statistics.median(of("symmetric_dirichlet_p99")),
        "area_ratio_spread_mean": mean("area_ratio_spread"),
        "volume_ratio_mean": mean("volume_ratio"),
        "displacement_mean": mean("displacement"),
        "chamfer_mean": mean("chamfer"),
        "neighbour_offset_mean": mean("neighbour_offset"),
        "neighbour_offset_max": max(of("neighbour_offset")),
        "texture_stretch_p95_mean": _mean_of_textured(states),
    }


def _share(states: States, who: str, hit: Callable[[dict[str, Any]], bool]) -> dict[str, float] | None:
    judged = [hit(state[who]) for state in states if state[who]]
    if not judged:
        return None
    low, high = wilson(sum(judged), len(judged))
    return {"hits": sum(judged), "count": len(judged), "share": sum(judged) / len(judged), "low": low, "high": high}


def _mean_of_textured(states: States) -> float | None:
    found = [
        float(state["quality"]["texture_stretch_p95"]) for state in states if "texture_stretch_p95" in state["quality"]
    ]
    return statistics.fmean(found) if found else None


def _mean(states: States, who: str, name: str) -> float | None:
    judged = [float(state[who][name]) for state in states if state[who]]
    return statistics.fmean(judged) if judged else None
