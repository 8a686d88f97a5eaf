"""Write the report of a run: `results.json`, `table.md` and `sheet.png`, all from the records in its folder."""

from __future__ import annotations

import json
import statistics
from pathlib import Path
from typing import Any

from meshdeform.errors import ParameterError
from meshdeform.support.files import write_files
from training.evaluation.plan import read_manifest
from training.evaluation.sheet import contact_sheet
from training.evaluation.summary import outweighed, states_of, summarise, summarise_kept
from training.evaluation.tables import comparison, kept_table, table

_RESULTS = "results.json"


def write_report(folder: Path) -> dict[str, Any]:
    """Summarise the records of a folder, and write the three files.

    Returns
    -------
    dict
        `manifest`; `summary`: for each number of steps `overall`, `by_prompt` and `by_source`; `done`, `failed` and
        `expected` items; `step_s_median`, for information; `records`.

    Raises
    ------
    ParameterError
        The folder contains no run.
    """
    manifest = read_manifest(folder)
    if manifest is None:
        raise ParameterError(f"There is no run in {folder}.", advice="Give the folder of a run.")
    records = [json.loads(path.read_text()) for path in sorted(folder.glob("items/*/record.json"))]
    good = [record for record in records if not record["failed"]]
    document = {
        "manifest": manifest,
        "expected": (len(manifest.get("pairs", ())) or len(manifest["sources"]) * len(manifest["prompts"]))
        * len(manifest["seeds"]),
        "done": len(good),
        "failed": len(records) - len(good),
        "summary": [_sums(good, steps, manifest) for steps in manifest["steps"]],
        "step_s_median": statistics.median(record["step_s_median"] for record in good) if good else None,
        "records": records,
    }
    write_files(
        {
            folder / _RESULTS: (json.dumps(document, indent=1) + "\n").encode(),
            folder / "table.md": _page(document).encode(),
            folder / "sheet.png": contact_sheet(folder, manifest, records),
        }
    )
    return document


def read_results(folder: Path) -> dict[str, Any]:
    """Read the results of a folder.

    Raises
    ------
    ParameterError
        The folder has no results.
    """
    try:
        results: dict[str, Any] = json.loads((folder / _RESULTS).read_text())
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"There are no results in {folder}: {error}.", advice="Give the folder of a finished run."
        ) from error
    return results


def compare(folders: list[Path]) -> str:
    """Return one table of several runs.

    Raises
    ------
    ParameterError
        A folder has no results.
    """
    return comparison([(folder.name, read_results(folder)) for folder in folders])


def _sums(records: list[dict[str, Any]], steps: int, manifest: dict[str, Any]) -> dict[str, Any]:
    states = states_of(records, steps)

    def by(member: str, names: list[str]) -> dict[str, Any]:
        return {name: summarise([state for state in states if state[member] == name]) for name in names}

    return {
        "steps": steps,
        "overall": summarise(states),
        "by_prompt": by("prompt", manifest["prompts"]),
        "by_source": by("source", list(manifest["sources"])),
        "kept": summarise_kept(states),
    }


def _page(document: dict[str, Any]) -> str:
    manifest, summary = document["manifest"], document["summary"]
    last = summary[-1]
    judge, clip = manifest["judge"], manifest["clip"]
    sources = [(Path(name).stem, row) for name, row in last["by_source"].items()]
    lines = [
        f"# Suite `{manifest['suite']}`, preset `{manifest['params']['preset']}`, prior `{manifest['prior']['id']}`"
        + (f", ablation `{manifest['ablation']}`\n" if manifest.get("ablation") else "\n"),
        f"{document['done']} of {document['expected']} done, {document['failed']} failed. "
        + f"Judge: {judge.get('id') or judge['missing']}; CLIP: {clip.get('id') or clip['missing']}. "
        "Retrieval with its 95 % interval; docs/quality.md defines every column.\n",
        table("steps", [(str(row["steps"]), row["overall"]) for row in summary], "Overall"),
        table("prompt", list(last["by_prompt"].items()), f"By prompt, after {last['steps']} steps"),
        table("source", sources, f"By source, after {last['steps']} steps"),
    ]
    if last["kept"] is not None:
        lines.insert(1, kept_table([("all", last["kept"])]))
    harder = outweighed(document["records"])
    if harder:
        lines += ["## Outweighed by a regulariser\n", *(f"- {line} as the guidance" for line in harder)]
    failed = [record for record in document["records"] if record["failed"]]
    if failed:
        lines.append("## Failed\n")
        lines += [
            f"- {record['source']}, {record['prompt']}, seed {record['seed']}: "
            f"{record['failed']['detail'].strip().splitlines()[-1]}"
            for record in failed
        ]
    return "\n".join(lines) + "\n"
