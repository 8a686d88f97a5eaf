"""Run the suite as a user would, whole jobs from the command line: ``python -m bench.keep FILES --out DIR``.

FILES is a folder with the assets, found by their hash (`assets.json` says where they are from). Each pair of an asset
and a prompt gets a folder (`bench.keep.runs`); one that the same code has run is not run again. ``--kind sds exemplar``
runs each kind, in a folder of its own in DIR; ``--code CHECKOUT`` runs another checkout, such as one of commit c23ea518
for the baseline. Then:

    python -m bench.keep.blind sheets before=DIR now=DIR       numbered rows that do not say what made them
    python -m bench.keep.blind sheets --grades grades.txt      tables of the grades
    python -m bench.keep.cost FILES                            CPU seconds and memory by the number of faces
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.keep.assets import SPLITS, Pair, pairs
from bench.keep.runs import KINDS, ROOT, Code, ran, verdict
from bench.parts.assets import files
from meshdeform.vocabulary.nouns import NOUN_GROUPS

DEFAULT = "default"


def main() -> None:
    """Run the pairs whose files are there, and print a line for each."""
    parser = argparse.ArgumentParser(description="Run real assets with a near and a far prompt each.")
    parser.add_argument("files", type=Path, help="where the files are")
    parser.add_argument("--out", type=Path, required=True, help="a folder for the results")
    parser.add_argument("--split", choices=SPLITS, help="only these assets")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only these assets")
    parser.add_argument("--group", nargs="+", default=[], choices=NOUN_GROUPS, help="only prompts for such nouns")
    kinds = (DEFAULT, *KINDS)
    parser.add_argument("--kind", nargs="+", choices=kinds, default=[DEFAULT], help="guidance.kind; default: not sent")
    parser.add_argument("--code", type=Path, default=ROOT, help="the checkout to run")
    asked = parser.parse_args()
    code, here = Code.of(asked.code.resolve()), files(asked.files)
    print(f"code {code.commit} {code.digest}", flush=True)
    every = pairs(asked.split, asked.only, asked.group)
    chosen = [pair for pair in every if pair.asset.sha256 in here]
    print(f"{len(chosen)} of {len(every)} pairs, those whose files are there", flush=True)
    for kind in asked.kind:
        _run(chosen, here, asked.out / kind if len(asked.kind) > 1 else asked.out, code, kind)


def _run(chosen: Sequence[Pair], here: Mapping[str, Path], out: Path, code: Code, kind: str) -> None:
    """Run the pairs with one kind, and print a line for each and one for all."""
    records = []
    for pair in chosen:
        sent = None if kind == DEFAULT else kind
        records.append(ran(pair, here[pair.asset.sha256], out / pair.name, code, sent))
        print(_line(pair.name, records[-1]), flush=True)
    if records:
        print(f"{kind}: {_summary(records)}")


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
