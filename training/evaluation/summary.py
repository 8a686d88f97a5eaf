"""Summarise records: shares with their intervals, means and worst cases of the measures."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable
from typing import Any

from training.evaluation.retrieval import wilson

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
        # A folder of an earlier version has no figure that was added since, and what cannot be counted is null.
        return [float(state["quality"].get(name) or 0.0) for state in states]

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


def summarise_kept(states: States) -> dict[str, Any] | None:
    """Compute one row of the table of what was kept (`delivered`); None if it was not measured.

    Returns
    -------
    dict
        `count`; `noun_first`: the share of results, of sources and of best stretches whose noun is first among all of
        the judge; `gained`: the share of results whose noun gained a rank over the source; `structure`: the mean and
        the largest of each figure; `worse_share`: the share of results that are worse than their source.
    """
    outcomes = [state["kept"] for state in states if state.get("kept")]
    if not outcomes:
        return None
    ranks = [each["noun_ranks"] for each in outcomes if "noun_ranks" in each]
    structure = {}
    for name in outcomes[0]["structure"]:
        values = [each["structure"][name] for each in outcomes if each["structure"][name] is not None]
        structure[name] = {"mean": statistics.fmean(values), "most": max(values)} if values else None
    return {
        "count": len(outcomes),
        "noun_first": {who: statistics.fmean(rank[who] == 1 for rank in ranks) for who in ranks[0]} if ranks else None,
        "gained": statistics.fmean(r["result"] < r["source"] for r in ranks) if ranks else None,
        "structure": structure,
        "worse_share": statistics.fmean(each["worse_than_source"] for each in outcomes) if ranks else None,
    }


def outweighed(records: Iterable[dict[str, Any]]) -> list[str]:
    """Return a line for each regulariser that pulled harder than the guidance, by the pulls of a run's records."""
    return [
        f"{record['source']}, {record['prompt']}, seed {record['seed']}: `{name}` pulled {pull:.2f} times as hard"
        for record in records
        for name, pull in (record.get("pulls") or {}).items()
        if pull > 1
    ]


def _share(states: States, who: str, hit: Callable[[dict[str, Any]], bool]) -> dict[str, float] | None:
    judged = [hit(state[who]) for state in states if state[who]]
    if not judged:
        return None
    low, high = wilson(sum(judged), len(judged))
    return {"hits": sum(judged), "count": len(judged), "share": sum(judged) / len(judged), "low": low, "high": high}


def _mean_of_textured(states: States) -> float | None:
    values = [
        float(state["quality"]["texture_stretch_p95"]) for state in states if "texture_stretch_p95" in state["quality"]
    ]
    return statistics.fmean(values) if values else None


def _mean(states: States, who: str, name: str) -> float | None:
    judged = [float(state[who][name]) for state in states if state[who]]
    return statistics.fmean(judged) if judged else None
