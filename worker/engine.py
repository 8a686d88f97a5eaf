"""What computes in a worker process: the kind of job, the device and the prior. The only place that imports torch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from meshdeform.settings import Settings
from worker.context import StartRun

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["Engine", "torch_engine"]


@dataclass(frozen=True)
class Engine:
    """Made once for the process.

    Attributes
    ----------
    start : StartRun
    load_prior : callable
        Gives the prior of a model; keeps it between jobs.
    device : str
    """

    start: StartRun
    load_prior: Callable[[str], Prior]
    device: str


def torch_engine(settings: Settings) -> Engine:
    """Load torch and what stands on it.

    Raises
    ------
    DependencyError
        The device that the settings name is not there.
    """
    from meshdeform.runs import text_deform
    from meshdeform.runs.devices import resolve_device, use_threads
    from worker.priors import PriorCache

    use_threads(settings.threads)
    device = resolve_device(settings.device)
    priors = PriorCache()

    def load_prior(model: str) -> Prior:
        return priors.get(model, device=device, revision=settings.model_revision if model == settings.model else "")

    return Engine(text_deform.start, load_prior, device)
