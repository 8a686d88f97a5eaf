"""What the commands about families share: pack a collection, drive a run, and write a folder."""

from __future__ import annotations

import dataclasses
import io
import json
import shlex
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.cli.overwriting import check_checkpoint
from meshdeform.errors import AssetEmptyError, AssetError, ParameterError

if TYPE_CHECKING:
    from meshdeform.assets import Limits
    from meshdeform.cli.progress import ProgressView
    from meshdeform.requests.document import JobRequest
    from meshdeform.runs.base import ArtifactData, JobRun, Kind

__all__ = ["FolderJob", "packed"]

_ENDINGS = {".glb", ".obj", ".ply", ".stl"}


@dataclass(frozen=True)
class FolderJob:
    """A job of a kind whose results fill a folder: where they go, and from what it continues.

    Attributes
    ----------
    kind : Kind
    output : Path
        The folder.
    checkpoint : Path, optional
        The file for its state.
    resume : Path, optional
        The file that it continues from.
    """

    kind: Kind
    output: Path
    checkpoint: Path | None
    resume: Path | None

    def check(self, *, force: bool) -> None:
        """Refuse to overwrite what no earlier run wrote, unless with `force`, and folders that cannot be written."""
        from meshdeform.cli.local_job import try_folder, writing

        if not force:
            check_folder(self.output, self.kind)
            if self.checkpoint is not None:
                check_checkpoint(self.checkpoint)
        with writing():
            try_folder(self.output / "report.json")
        if self.checkpoint is not None:
            with writing("The checkpoint", "--checkpoint"):
                try_folder(self.checkpoint)

    def carry_out(
        self, request: JobRequest, files: Mapping[str, tuple[bytes, str]], limits: Limits, every: int, *, quiet: bool
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Run the job and write the folder; return what to say about it, and its report.

        Parameters
        ----------
        request : JobRequest
        files : mapping of str to (bytes, str)
            The bytes and the name of each file, by its part.
        limits : Limits
        every : int
            Steps between two checkpoints.
        quiet : bool
        """
        from meshdeform.cli.progress import show_progress
        from meshdeform.runs.base import InputFile, RunInput

        state = self.resume.read_bytes() if self.resume else None
        given = {part: InputFile(data, name) for part, (data, name) in files.items()}
        with show_progress(quiet=quiet) as progress:
            progress.phase("loading")
            run = self.kind.load()(RunInput(request=request, files=given, checkpoint=state, limits=limits))
            progress.phase("optimizing")
            drive(run, every, progress, self.checkpoint)
            progress.phase("writing")
            written = write_folder(run.finish(), self.output, self.kind)
        report = json.loads((self.output / "report.json").read_text(encoding="utf-8"))
        summary = {"folder": str(self.output), "files": written, "steps": run.step, "resumed": state is not None}
        return summary, report


def drive(run: JobRun, every: int, progress: ProgressView, checkpoint: Path | None) -> None:
    """Do the steps; store checkpoints, also at Ctrl-C."""
    from meshdeform.cli.interrupting import ctrl_c_between_steps
    from meshdeform.cli.local_job import writing
    from meshdeform.support.files import write_files

    with ctrl_c_between_steps() as interrupted:
        for report in run:
            progress.step(report.step, report.total_steps, report.losses["total"])
            stop = interrupted()
            if checkpoint is not None and (stop or report.step % every == 0):
                with writing("The checkpoint", "--checkpoint"):
                    write_files({checkpoint: run.checkpoint()})
            if stop:
                detail, advice = "Nothing was written.", "With --checkpoint FILE it could be resumed."
                if checkpoint is not None:
                    detail = f"The state is in {checkpoint}."
                    advice = f"Continue with --resume {shlex.quote(str(checkpoint))}"
                where = f"Interrupted at step {report.step} of {report.total_steps}."
                raise OutcomeError(ExitCode.INTERRUPTED, "interrupted", f"{where} {detail}", advice)


def packed(path: Path, most: int, labels: Path | None = None) -> bytes:
    """Return the ZIP of a folder, or the given one, with the labels.

    Raises
    ------
    AssetError
        The folder holds no asset, or too many bytes; or the ZIP cannot be read.
    """
    if path.is_file() and labels is None:
        return path.read_bytes()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        if path.is_dir():
            chosen = sorted(each for each in path.rglob("*") if each.suffix.lower() in _ENDINGS and each.is_file())
            if not chosen:
                raise AssetEmptyError(
                    f"The folder {path} holds no asset.", advice="Give a folder with 10 to 3,000 GLB, OBJ, PLY or STL."
                )
            total = sum(each.stat().st_size for each in chosen)
            if total > most:
                raise AssetError(f"The assets have {total} bytes; the limit is {most} (MESHDEFORM_MAX_UPLOAD_BYTES).")
            for each in chosen:
                archive.writestr(zipfile.ZipInfo(each.relative_to(path).as_posix()), each.read_bytes())
            beside = path / "labels.json"
            labels = labels or (beside if beside.is_file() else None)
        else:
            for name, data in _unpacked(path, most).items():
                archive.writestr(zipfile.ZipInfo(name), data)
        if labels is not None:
            archive.writestr(zipfile.ZipInfo("labels.json"), labels.read_bytes())
    return buffer.getvalue()


def _unpacked(path: Path, most: int) -> dict[str, bytes]:
    """Return the files of a ZIP but its labels, with the checks that the job makes."""
    from meshdeform.assets.collection import LABELS_FILE, unpacked
    from meshdeform.assets.limits import Limits

    files = unpacked(path.read_bytes(), dataclasses.replace(Limits(), max_bytes=most))
    return {name: data for name, data in files.items() if name != LABELS_FILE}


def check_folder(folder: Path, kind: Kind) -> None:
    """Refuse a folder that holds files of somebody else under the names of results of this kind."""
    there = [artifact.name for artifact in kind.artifacts if (folder / artifact.name).exists()]
    if not there:
        return
    try:
        ours = json.loads((folder / "report.json").read_bytes())["kind"] == str(kind.name)
    except (OSError, ValueError, KeyError, TypeError):
        ours = False
    if not ours:
        raise ParameterError(
            f"{folder / there[0]} exists and was not written by an earlier run.",
            advice="Choose another folder with -o, or overwrite it with --force.",
        )


def write_folder(artifacts: dict[str, ArtifactData], folder: Path, kind: Kind) -> list[str]:
    """Write all results or none, and remove those of an earlier run that this one has not; return the names."""
    from meshdeform.cli.interrupting import ctrl_c_between_steps
    from meshdeform.cli.local_job import writing
    from meshdeform.support.files import write_files

    with ctrl_c_between_steps(), writing():
        write_files({folder / name: artifact.data for name, artifact in artifacts.items()})
        for artifact in kind.artifacts:
            if artifact.name not in artifacts:
                (folder / artifact.name).unlink(missing_ok=True)
    return list(artifacts)
