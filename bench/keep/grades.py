"""Tables of the grades that a person gave by eye, not knowing what had made a result.

A grade is three figures from 0 to 5: a, it reads as the noun, with what else the prompt asks for; b, it is still the
asset; c, an artist would keep it. Worth keeping is c of 3 and more. A result of which its own run says to keep the
source (`keep_source`) has its grades in the means and counts as not kept. A run that failed counts as not kept as well.

`grades.json`: {"seed": of the shuffle, "commits": {run: commit}, "rows": [row]}, a row as `Row` has it.
"""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.keep.assets import DISTANCES, SPLITS, group_of
from meshdeform.vocabulary.nouns import NOUN_GROUPS

GRADES = Path(__file__).with_name("grades.json")
KEPT = 3
MOST = 5
_SURE = 1.96
Grade = tuple[int, int, int]


@dataclass(frozen=True)
class Row:
    """A result of a run, and its grade."""

    run: str
    asset: str
    split: str
    distance: str
    prompt: str
    verdict: str
    grade: Grade | None = None

    @property
    def kept(self) -> bool:
        """Whether it is worth keeping, and was not taken back by its own run."""
        return self.grade is not None and self.grade[2] >= KEPT and self.verdict != "keep_source"


def parsed(text: str, rows: int) -> dict[int, Grade]:
    """Parse lines `number a b c`; what follows is a remark, and empty lines are left out.

    Returns
    -------
    Mapping of the row's number, from 1, to its grade.

    Raises
    ------
    ValueError
        A line has another form, a number is none of the rows' or comes twice, or a figure is beyond 0 to 5.
    """
    grades: dict[int, Grade] = {}
    for line in text.splitlines():
        if not line.strip():
            continue
        number, a, b, c = (int(part) for part in line.split()[:4])
        if not 1 <= number <= rows or number in grades or not all(0 <= each <= MOST for each in (a, b, c)):
            raise ValueError(f"{line!r}: no such row, a second grade, or a figure beyond 0 to {MOST}")
        grades[number] = (a, b, c)
    return grades


def table(rows: Sequence[Row]) -> str:
    """Return a table in Markdown: of each run, split and distance, and of both distances, means and what is kept."""
    lines = [
        "| run | split | prompts | results | a | b | c | c >= 3 | keep_source | failed |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for run in dict.fromkeys(row.run for row in rows):
        for split in SPLITS:
            for asked in (*[(each,) for each in DISTANCES], DISTANCES):
                chosen = [row for row in rows if row.run == run and row.split == split and row.distance in asked]
                if any(row.grade for row in chosen):
                    name = asked[0] if len(asked) == 1 else "both"
                    lines.append(f"| {run} | {split} | {name} | " + " | ".join(_figures(chosen)) + " |")
    return "\n".join(lines)


def by_group(rows: Sequence[Row]) -> str:
    """Return a table in Markdown: of each group of nouns that prompts ask for, what is kept of each run's results."""
    runs = list(dict.fromkeys(row.run for row in rows))
    lines = [f"| prompts for | {' | '.join(runs)} |", "|---" * (len(runs) + 1) + "|"]
    counted = [row for row in rows if row.grade or row.verdict == "failed"]
    for group in NOUN_GROUPS:
        of = [[row for row in counted if row.run == run and group_of(row.prompt) == group] for run in runs]
        if any(of):
            told = [f"{sum(row.kept for row in each)} of {len(each)}" for each in of]
            lines.append(f"| {group} | {' | '.join(told)} |")
    return "\n".join(lines)


def by_verdict(rows: Sequence[Row]) -> str:
    """Return a table in Markdown: of each run and split, how often its verdicts are right, with Wilson intervals."""
    lines = [
        "| run | split | results | worth keeping | `good` is right | of these, `good` | `keep_source` is right |",
        "|---|---|---|---|---|---|---|",
    ]
    for run in dict.fromkeys(row.run for row in rows if row.verdict not in ("none", "failed")):
        for split in SPLITS:
            chosen = [row for row in rows if row.run == run and row.split == split and row.grade]
            worth = [row for row in chosen if row.grade and row.grade[2] >= KEPT]
            good = [row for row in chosen if row.verdict == "good"]
            right = share(sum(row in worth for row in good), len(good))
            called = share(sum(row in good for row in worth), len(worth))
            back = [row for row in chosen if row.verdict == "keep_source"]
            left = share(sum(row not in worth for row in back), len(back))
            if chosen:
                lines.append(f"| {run} | {split} | {len(chosen)} | {len(worth)} | {right} | {called} | {left} |")
    return "\n".join(lines)


def share(part: int, whole: int) -> str:
    """Return a share with its Wilson interval at 95 %."""
    if not whole:
        return "-"
    rate = part / whole
    middle = rate + _SURE**2 / (2 * whole)
    spread = _SURE * math.sqrt(rate * (1 - rate) / whole + _SURE**2 / (4 * whole**2))
    low, high = ((middle + sign * spread) / (1 + _SURE**2 / whole) for sign in (-1, 1))
    return f"{part} of {whole}, {rate:.0%} ({max(low, 0):.0%} to {min(high, 1):.0%})"


def _figures(rows: Sequence[Row]) -> Iterable[str]:
    """Return what the table says of some rows, without those that wait for a grade."""
    graded = [row for row in rows if row.grade is not None]
    failed = sum(row.verdict == "failed" for row in rows)
    means = (statistics.fmean(row.grade[k] for row in graded if row.grade) for k in range(3))
    kept = sum(row.kept for row in graded) / (len(graded) + failed)
    taken_back = sum(row.verdict == "keep_source" for row in graded)
    return [str(len(graded)), *(f"{mean:.1f}" for mean in means), f"{kept:.0%}", str(taken_back), str(failed)]


def saved(seed: int, commits: dict[str, str], rows: Sequence[Row]) -> str:
    """Return the document of `grades.json`."""
    lines = ",\n".join("  " + json.dumps(vars(row)) for row in rows)
    return f'{{\n "seed": {seed},\n "commits": {json.dumps(commits)},\n "rows": [\n{lines}\n ]\n}}\n'


def read(text: str) -> list[Row]:
    """Return the rows of a document of `grades.json`."""
    rows = json.loads(text)["rows"]
    return [Row(**{**row, "grade": None if row["grade"] is None else tuple(row["grade"])}) for row in rows]
