"""Run the suite as a user would, whole jobs from the command line: ``python -m bench.keep FILES --out DIR``.

FILES is a folder with the assets, found by their hash (`assets.json` says where they are from). Each pair of an asset
and a prompt gets a folder (`bench.keep.runs`); one that the same code has run is not run again. ``--code CHECKOUT``
runs another checkout, such as one of commit c23ea518 for the baseline. Then:

    python -m bench.keep.blind sheets before=DIR now=DIR       numbered rows that do not say what made them
    python -m bench.keep.blind sheets --grades grades.txt      a table of the grades
    python -m bench.keep.cost FILES                            CPU seconds and memory by the number of faces
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

from bench.keep.assets import SPLITS, pairs
from bench.keep.runs import KINDS, ROOT, Code, ran, verdict
from bench.parts.assets import files


def main() -> None:
    """Run the pairs whose files are there, and print a line for each."""
    parser = argparse.ArgumentParser(description="Run real assets with a near and a far prompt each.")
    parser.add_argument("files", type=Path, help="where the files are")
    parser.add_argument("--out", type=Path, required=True, help="a folder for the results")
    parser.add_argument("--split", choices=SPLITS, help="only these assets")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only these assets")
    parser.add_argument("--kind", choices=KINDS, help="guidance.kind; without it, what the code does by default")
    parser.add_argument("--code", type=Path, default=ROOT, help="the checkout to run")
    asked = parser.parse_args()
    code, here = Code.of(asked.code.resolve()), files(asked.files)
    print(f"code {code.commit} {code.digest}", flush=True)
    records = []
    for pair in pairs(asked.split, asked.only):
        if pair.asset.sha256 not in here:
            print(f"{pair.name:34} is not there", flush=True)
            continue
        records.append(ran(pair, here[pair.asset.sha256], asked.out / pair.name, code, asked.kind))
        print(_line(pair.name, records[-1]), flush=True)
    if records:
        print(_summary(records))


def _line(name: str, record: dict[str, Any]) -> str:
    said = record["problem"] or _measures(record["report"])
    return (
        f"{name:34} {record['prompt']:28} {record['cpu_seconds']:6.1f} s {record['megabytes']:5} MB  "
        f"{verdict(record):12} {said}"
    )


def _measures(report: dict[str, Any]) -> str:
    quality, noun = report["quality"], report.get("likeness") or {}
    told = f"{quality['flipped_faces']} flipped, {quality['self_intersections_added']} cut"
    return f"{told}, rank {noun['rank']}" if "rank" in noun else told


def _summary(records: list[dict[str, Any]]) -> str:
    seconds = sorted(each["cpu_seconds"] for each in records)
    memory = max(each["megabytes"] for each in records)
    counted = Counter(verdict(each) for each in records)
    said = ", ".join(f"{count} {name}" for name, count in counted.most_common())
    return f"{len(records)} run: {said}; median {seconds[len(seconds) // 2]:.1f} CPU s, at most {memory} MB"


if __name__ == "__main__":
    main()
