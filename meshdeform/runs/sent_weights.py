"""Use taught weights that are a file of a job: describe the part, check that it is there, load it. Torch-free."""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from meshdeform.errors import ParameterError
from meshdeform.priors.public_names import hidden_folders
from meshdeform.requests.models import SENT_MODEL, TAUGHT_SUFFIX, WEIGHTS_PART, is_sent, teaching_job
from meshdeform.runs.base import FilePart, InputFile, RunInput

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["TAUGHT_WEIGHTS", "WEIGHTS_ARTIFACT", "WEIGHTS_FILE", "check_weights_part", "load_sent", "weights_on_disk"]

WEIGHTS_ARTIFACT = f"weights{TAUGHT_SUFFIX}"
"""The artifact of a job of kind `prior_teach` that `params.guidance.model` = `job:ID` means."""
TAUGHT_WEIGHTS = "application/octet-stream"
WEIGHTS_FILE = FilePart(
    WEIGHTS_PART,
    "Taught weights (safetensors), if the model is `weights`; with `job:ID` they are taken from that job.",
    required=False,
    media_types=(TAUGHT_WEIGHTS,),
    content="weights",
)


def check_weights_part(model: str | None, files: Collection[str], *group: str) -> None:
    """Refuse a job whose model is taught weights that it lacks, or that has weights which its model does not use.

    `group` is where `model` is in `params`.

    Raises
    ------
    ParameterError
    """
    place = ["params", *group, "model"]
    wanted, there = model is not None and is_sent(model), WEIGHTS_PART in files
    if there and not wanted:
        raise ParameterError.at(
            place,
            f"`{WEIGHTS_PART}` was sent, but {'.'.join(place)} does not use it.",
            f"Set {'.'.join(place)} to `{SENT_MODEL}`.",
        )
    if wanted and not there and model is not None:
        job = teaching_job(model)
        if job is None:
            raise ParameterError.at(
                place,
                f"{'.'.join(place)} is `{model}`, but the part `{WEIGHTS_PART}` is missing.",
                "Send the weights.",
            )
        raise ParameterError.at(
            place,
            f"The model {model} is a result of a service, and there is none here.",
            f"Download {WEIGHTS_ARTIFACT} of the job {job}, and name that file.",
        )


def load_sent(model: str, given: RunInput) -> Prior:
    """Load the prior of a job: taught weights among its files, or the model of this name."""
    if not is_sent(model):
        with hidden_folders([model]):
            return given.load_prior(model)
    with weights_on_disk(given.files[WEIGHTS_PART]) as path, hidden_folders([str(path)]):
        prior = given.load_prior(str(path))
    # The file is gone, and the prior is kept for other jobs with equal weights: reports and checkpoints name the model.
    named = copy.copy(prior)
    vars(named)["identity"] = {**prior.identity, "id": model}
    return named


@contextmanager
def weights_on_disk(file: InputFile) -> Iterator[Path]:
    """Write weights to a file that is deleted when the block ends: safetensors reads files."""
    with tempfile.TemporaryDirectory(prefix="meshdeform-weights-") as folder:
        path = Path(folder) / WEIGHTS_ARTIFACT
        path.write_bytes(file.data)
        yield path
