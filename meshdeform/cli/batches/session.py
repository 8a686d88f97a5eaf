"""One run of a batch: select the rows to do, run and show them, and write the summary, also after Ctrl-C.

The summary is tables, the contact sheet of before and after, and results as morph targets.
"""

from __future__ import annotations

import csv
import io
import json
import math
import queue
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import Row
from meshdeform.cli.batches.runners import RowOutcome, Runner
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.cli.local import read_asset, writing
from meshdeform.cli.output import BatchView, ProgressView, duration, emit, note, show_batch
from meshdeform.requests.choices import GuidanceKind
from meshdeform.support.files import write_files
from meshdeform.verdicts import read_verdict

if TYPE_CHECKING:
    from PIL import Image

    from meshdeform.assets import Asset, Limits
    from meshdeform.requests.document import DeformParams
    from meshdeform.settings import Settings

_QUALITY = ("flipped_faces", "self_intersections_added", "symmetric_dirichlet_p99", "volume_ratio")
_COLUMNS = (
    *("name", "state", "verdict", "asset", "prompt", "target", "preset", "seed", "model", "steps", "seconds", "loss"),
    *_QUALITY,
    *("job_id", "error_code", "error", "result"),
)
_WIDTH, _HEIGHT, _CAPTION, _GAP = 288, 144, 30, 8
_MAX_TILES, _LETTERS = 600, 48
_RED, _GREY, _INK = (198, 40, 40), (205, 205, 205), (30, 30, 30)


class _RowProgress(ProgressView):
    """Passes the steps of a row on to the thread that shows them."""

    def __init__(self, row: Row, steps: Callable[..., None]) -> None:
        self._row, self._steps = row, steps

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:  # noqa: ARG002
        self._steps(self._row.name, step, total_steps, loss)


class Session:
    """One run of a batch. With `as_json`, each row that ends is a line on standard output."""

    def __init__(self, ledger: Ledger, *, as_json: bool, quiet: bool) -> None:
        self.ledger, self.folder, self._as_json, self._quiet = ledger, ledger.path.parent, as_json, quiet

    def run(self, rows: Sequence[Row], runner: Runner, parallel: int, *, retry_failed: bool) -> None:
        """Run the rows that are not done or have lost their result, failed ones only with `retry_failed`.

        An OutcomeError tells of a Ctrl-C, with the summary written; another error that the batch cannot continue, since
        the service or the disk is unavailable.
        """
        todo = [row for row in rows if self._is_left(row, retry_failed=retry_failed)]
        if len(todo) < len(rows):
            note(f"{len(rows) - len(todo)} of {len(rows)} rows are finished already.", quiet=self._quiet)
        try:
            with show_batch(len(rows), len(rows) - len(todo), quiet=self._quiet) as view:
                self._run(todo, runner, parallel, view)
        except KeyboardInterrupt:
            counts, _ = self.finish(rows)
            raise OutcomeError(
                ExitCode.INTERRUPTED,
                "interrupted",
                f"Interrupted: {counts['succeeded']} of {counts['rows']} rows are done.",
                "Run the same command to do the rest.",
                **counts,
            ) from None
        finally:
            runner.close()

    def finish(self, rows: Sequence[Row]) -> tuple[dict[str, int], dict[str, str]]:
        """Write the summary; return the number of rows in each state and the paths of the files."""
        records = [record_of(row, self.ledger.last.get(row.key), self.folder) for row in rows]
        pictures = [row.path(self.folder, "preview.png") for row in rows]
        with writing("The summary", "Free some space, then run the same command again."):
            files = write_summary(self.folder, self.ledger.batch_id, records, pictures)
        return count_states(records), files

    def _run(self, rows: Sequence[Row], runner: Runner, parallel: int, view: BatchView) -> None:
        """Run rows in threads, up to `parallel` at a time; show and record them in this thread."""
        # The first exception of the runner ends the batch; running rows are abandoned.
        todo: queue.SimpleQueue[Row] = queue.SimpleQueue()
        for row in rows:
            todo.put(row)
        calls: queue.SimpleQueue[Callable[[], None] | Exception] = queue.SimpleQueue()
        stop = threading.Event()

        def show_step(*step: Any) -> None:
            calls.put(partial(view.step, *step))

        def work() -> None:
            while not stop.is_set():
                try:
                    row = todo.get_nowait()
                except queue.Empty:
                    return
                calls.put(partial(view.start, row.name))
                try:
                    outcome = runner.do(row, _RowProgress(row, show_step))
                except Exception as error:  # raised again in the waiting thread
                    calls.put(error)
                    return
                calls.put(partial(end, row, outcome))

        left = len(rows)

        def end(row: Row, outcome: RowOutcome) -> None:
            nonlocal left
            left -= 1
            self._end(row, outcome, view)

        for number in range(min(parallel, len(rows))):
            # Daemon threads, so that one that is waiting cannot keep the process alive.
            threading.Thread(target=work, name=f"row {number}", daemon=True).start()
        try:
            while left:
                call = calls.get()
                if isinstance(call, Exception):
                    raise call
                call()
        finally:
            stop.set()

    def _is_left(self, row: Row, *, retry_failed: bool) -> bool:
        line = self.ledger.last.get(row.key, {})
        if line.get("event") == "failed":
            return retry_failed
        return line.get("event") != "done" or not row.path(self.folder, "result.glb").exists()

    def _end(self, row: Row, outcome: RowOutcome, view: BatchView) -> None:
        more: dict[str, Any] = {"state": outcome.state, "seconds": outcome.seconds, "losses": outcome.losses}
        if outcome.job_id is not None:
            more["job_id"] = outcome.job_id
        succeeded = outcome.state == "succeeded"
        ending = {"files": outcome.files} if succeeded else {"error": outcome.error}
        self.ledger.append("done" if succeeded else "failed", row.key, row.name, **ending, **more)
        reason = f": {outcome.error['detail']}" if outcome.error else ""
        line = f"{row.name}  {outcome.state}  {duration(outcome.seconds)}{reason}"
        view.end(row.name, line, failed=not succeeded)
        if self._as_json:
            emit({"event": "row", **record_of(row, self.ledger.last[row.key], self.folder)})


def record_of(row: Row, line: Mapping[str, Any] | None, folder: Path) -> dict[str, Any]:
    """Return the record of a row: its request, its state, and the quality of its result by its report.

    `line` is the newest one of the ledger about the row, `folder` that of the batch.
    """
    line, request = line or {}, row.request
    done = line.get("event") == "done"
    state = "succeeded" if done else line.get("state", "failed") if line.get("event") == "failed" else "pending"
    report = _report(row.path(folder, "report.json")) if done else {}
    quality = report.get("quality", {})
    error = line.get("error") or {}
    return {
        "name": row.name,
        "state": state,
        "verdict": (read_verdict(report) or {}).get("value"),
        "asset": str(row.asset),
        "prompt": request.prompt,
        "target": str(row.target) if row.target else None,
        "seed": request.params.seed,
        **_method(request.params, report.get("params", {})),
        "seconds": line.get("seconds"),
        "loss": (line.get("losses") or {}).get("total"),
        **{name: quality.get(name) for name in _QUALITY},
        "job_id": line.get("job_id"),
        "error_code": error.get("code"),
        "error": error.get("detail"),
        "result": str(row.path(folder, "result.glb")) if done else None,
    }


def _method(asked: DeformParams, resolved: Mapping[str, Any]) -> dict[str, Any]:
    """Return the preset, the model and the steps of a row; a fit to an exemplar has none."""
    if resolved.get("guidance", asked.kind) == GuidanceKind.EXEMPLAR:  # a service may have decided it
        return dict.fromkeys(("preset", "model", "steps"))
    steps = resolved.get("steps", asked.model_dump().get("steps"))
    return {"preset": asked.preset.value, "model": resolved.get("model", asked.model), "steps": steps}


def count_states(records: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Count the rows that are `succeeded`, `failed` (also canceled and expired) and `pending`."""
    states = Counter(record["state"] for record in records)
    good, waiting = states["succeeded"], states["pending"]
    return {"rows": len(records), "succeeded": good, "failed": len(records) - good - waiting, "pending": waiting}


def write_summary(
    folder: Path, batch_id: str, records: Sequence[dict[str, Any]], pictures: Sequence[Path]
) -> dict[str, str]:
    """Write the files, all or none, and return their paths by name. Without Pillow there is no sheet."""
    document = {"batch": batch_id, **count_states(records), "rows_detail": list(records)}
    files = {
        folder / "summary.csv": _csv_table(records).encode(),
        folder / "summary.json": (json.dumps(document, indent=1) + "\n").encode(),
    }
    if find_spec("PIL") is not None and (sheet := contact_sheet(records, pictures)):
        files[folder / "sheet.png"] = sheet
    write_files(files)
    return {path.name: str(path) for path in files}


def _csv_table(records: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, _COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return text.getvalue()


def _report(path: Path) -> dict[str, Any]:
    try:
        report = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}
    return report if isinstance(report, dict) else {}


def contact_sheet(records: Sequence[Mapping[str, Any]], pictures: Sequence[Path]) -> bytes | None:
    """Return a PNG with the first 600 rows, by their records and pictures; None if no row succeeded."""
    from PIL import Image, ImageDraw, ImageFont

    if not any(record["state"] == "succeeded" for record in records):
        return None
    shown = records[:_MAX_TILES]
    columns = max(1, round(math.sqrt(len(shown) / 1.5)))
    width, height = _WIDTH + _GAP, _HEIGHT + _CAPTION + _GAP
    sheet = Image.new("RGB", (_GAP + columns * width, _GAP + math.ceil(len(shown) / columns) * height), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(11)
    for number, (record, path) in enumerate(zip(shown, pictures, strict=False)):
        x, y = _GAP + number % columns * width, _GAP + number // columns * height
        succeeded = record["state"] == "succeeded"
        pair = _before_and_after(path) if succeeded else None
        if pair is not None:
            sheet.paste(pair, (x, y))
        colour = _GREY if succeeded or record["state"] == "pending" else _RED
        draw.rectangle((x - 1, y - 1, x + _WIDTH, y + _HEIGHT), outline=colour)
        why = record["prompt"] if succeeded else record["error_code"] or record["state"]
        draw.text((x, y + _HEIGHT + 2), str(record["name"])[:_LETTERS], fill=_INK, font=font)
        draw.text((x, y + _HEIGHT + 15), str(why)[:_LETTERS], fill=_INK if succeeded else colour, font=font)
    out = io.BytesIO()
    sheet.save(out, "PNG", optimize=True)
    return out.getvalue()


def _before_and_after(path: Path) -> Image.Image | None:
    """Return the first view of a preview's two rows side by side; None if it cannot be read."""
    from PIL import Image

    try:
        with Image.open(path) as preview:
            rows = preview.convert("RGB")
    except (OSError, ValueError, Image.DecompressionBombError):
        return None
    side, pair = rows.height // 2, Image.new("RGB", (_WIDTH, _HEIGHT), "white")
    for row in range(2):
        view = rows.crop((0, row * side, side, (row + 1) * side))
        pair.paste(view.resize((_HEIGHT, _HEIGHT), Image.Resampling.LANCZOS), (row * _WIDTH // 2, 0))
    return pair


def write_target_sets(folder: Path, rows: Sequence[Row], settings: Settings) -> dict[str, str]:
    """Write, for each asset, the source with its results as morph targets, named after their rows and of weight 0.

    Returns the paths by name. A ParameterError tells that rows of one asset differ in `params.control.exclude` or
    `output.subdivide`.
    """
    from meshdeform.assets import Limits
    from meshdeform.assets.morph import MorphTarget
    from meshdeform.runs.strength import check_same_asset

    limits = Limits.from_settings(settings)
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
        source = read_asset(asset, limits)
        pairs = [_row_result(source, row, folder, limits) for row in own]
        base = pairs[0][0]
        for row, (_, result) in zip(own, pairs, strict=True):
            check_same_asset(base, result, (own[0].name, row.name))
        shapes = [(row.name, result.surface) for row, (_, result) in zip(own, pairs, strict=True)]
        targets = [MorphTarget(name, s.positions, s.normals, s.tangents) for name, s in shapes]
        files[path] = base.morph(targets, weights=[0.0] * len(targets))
    with writing("The morph targets", "Free some space, then run the same command again."):
        write_files(files)
    return {path.name: str(path) for path in files}


def _row_result(source: Asset, row: Row, folder: Path, limits: Limits) -> tuple[Asset, Asset]:
    """Return the source as a row deformed it, and the row's result."""
    from meshdeform.runs.strength import matched
    from meshdeform.runs.surfaces import read_result

    result = read_result(row.path(folder, "result.glb").read_bytes())
    return matched(source, result, row.request.params.control.exclude, limits)
