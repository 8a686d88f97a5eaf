"""Write the summary of a batch: `summary.csv`, `summary.json` and the contact sheet `sheet.png`."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from meshdeform.cli.batches.rows import Row
from meshdeform.support.files import write_files

__all__ = ["count_states", "record_of", "write_summary"]

_QUALITY = ("flipped_faces", "self_intersections_added", "symmetric_dirichlet_p99", "volume_ratio")
_COLUMNS = (
    *("name", "state", "asset", "prompt", "target", "preset", "seed", "model", "steps", "seconds", "loss"),
    *_QUALITY,
    *("job_id", "error_code", "error", "result"),
)


def record_of(row: Row, line: Mapping[str, Any] | None, folder: Path) -> dict[str, Any]:
    """Return the record of a row: its request, its state, and the quality of its result by its report.

    Parameters
    ----------
    row : Row
    line : mapping, optional
        The newest line of the ledger about the row.
    folder : Path
        The folder of the batch.
    """
    line, request = line or {}, row.request
    done = line.get("event") == "done"
    state = "succeeded" if done else line.get("state", "failed") if line.get("event") == "failed" else "pending"
    report = _report(row.path(folder, "report.json")) if done else {}
    params, quality = report.get("params", {}), report.get("quality", {})
    error = line.get("error") or {}
    return {
        "name": row.name,
        "state": state,
        "asset": str(row.asset),
        "prompt": request.prompt,
        "target": str(row.target) if row.target else None,
        "preset": request.params.preset.value,
        "seed": request.params.seed,
        "model": params.get("model", request.params.model),
        "steps": params.get("steps", request.params.model_dump().get("steps")),
        "seconds": line.get("seconds"),
        "loss": (line.get("losses") or {}).get("total"),
        **{name: quality.get(name) for name in _QUALITY},
        "job_id": line.get("job_id"),
        "error_code": error.get("code"),
        "error": error.get("detail"),
        "result": str(row.path(folder, "result.glb")) if done else None,
    }


def count_states(records: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Count the rows that are `succeeded`, `failed` (also canceled and expired) and `pending`."""
    found = Counter(record["state"] for record in records)
    good, waiting = found["succeeded"], found["pending"]
    return {"rows": len(records), "succeeded": good, "failed": len(records) - good - waiting, "pending": waiting}


def write_summary(
    folder: Path, batch_id: str, records: Sequence[dict[str, Any]], pictures: Sequence[Path]
) -> dict[str, str]:
    """Write the files, all or none, and return their paths by name. Without Pillow there is no sheet.

    Parameters
    ----------
    folder : Path
        The folder of the batch.
    batch_id : str
    records : sequence of dict
        What `record_of` returns for each row.
    pictures : sequence of Path
        The picture of each row, which need not exist.

    Raises
    ------
    OSError
        The files cannot be written.
    """
    document = {"batch": batch_id, **count_states(records), "rows_detail": list(records)}
    files = {
        folder / "summary.csv": _table(records).encode(),
        folder / "summary.json": (json.dumps(document, indent=1) + "\n").encode(),
    }
    if find_spec("PIL") is not None and (sheet := _sheet(records, pictures)):
        files[folder / "sheet.png"] = sheet
    write_files(files)
    return {path.name: str(path) for path in files}


def _sheet(records: Sequence[Mapping[str, Any]], pictures: Sequence[Path]) -> bytes | None:
    from meshdeform.cli.batches.sheet import contact_sheet

    return contact_sheet(records, pictures)


def _table(records: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, _COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return text.getvalue()


def _report(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
