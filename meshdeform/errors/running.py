"""Define the errors of jobs that run and of what they need: checkpoints, workers, devices and other services."""

from __future__ import annotations

from meshdeform.errors.base import MeshdeformError

__all__ = [
    "CheckpointError",
    "DependencyError",
    "DeviceMemoryError",
    "NumericalError",
    "ShapeError",
    "StoredFileError",
    "UnavailableError",
    "WorkerLostError",
    "install_command",
]


class CheckpointError(MeshdeformError):
    """The checkpoint cannot be used."""

    code = "checkpoint_invalid"
    advice = "Start again from an older checkpoint or from the beginning."


class StoredFileError(MeshdeformError):
    """A stored file is damaged."""

    code = "file_damaged"
    advice = "Send the same file again, which replaces the stored copy; a damaged result has to be computed again."


class NumericalError(MeshdeformError):
    """The computation broke down."""

    code = "numerical_failure"
    advice = "Lower learning_rate or guidance_scale, or repair the mesh; report.json says what was skipped."


class WorkerLostError(MeshdeformError):
    """Every attempt at the job lost its worker."""

    code = "worker_lost"
    advice = "Check the workers' logs (a common cause is lack of memory), then post the job again."


class DeviceMemoryError(MeshdeformError):
    """The device ran out of memory in every attempt."""

    code = "gpu_oom"
    advice = "Simplify the mesh, choose a smaller model, or run a worker on a device with more memory."


class UnavailableError(MeshdeformError):
    """A service that Meshdeform needs does not respond."""

    status = 503
    code = "unavailable"
    advice = "Try again in a moment; /readyz shows which part is unavailable."


class DependencyError(MeshdeformError):
    """A required program or package is not installed."""

    code = "dependency_missing"
    advice = "Install what the message names."


def install_command(extra: str = "") -> str:
    """Return what advice says about installing Meshdeform, or an extra of it: no index of packages has it."""
    return f'pip install -e "{f".[{extra}]" if extra else "."}", in a clone of Meshdeform'


class ShapeError(ValueError):
    """An array has the wrong shape, dtype or device."""
