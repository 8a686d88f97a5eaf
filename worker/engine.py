"""Load the kinds of job, the device and the prior in a worker process. Torch is imported here."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from meshdeform.priors.builtin.taught import MAX_FILE_BYTES
from meshdeform.requests.models import is_taught
from meshdeform.runs import kinds, start_run
from meshdeform.runs.base import StartRun
from meshdeform.settings import Settings

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["Engine", "PriorCache", "torch_engine"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Engine:
    """The functions and the device that run jobs, created once per process.

    Attributes
    ----------
    start : StartRun
    load_prior : callable
        Returns the prior of a model and keeps it between jobs.
    device : str
    """

    start: StartRun
    load_prior: Callable[[str], Prior]
    device: str


def torch_engine(settings: Settings) -> Engine:
    """Load torch and the kinds of job, and return the engine.

    Raises
    ------
    DependencyError
        The device named in the settings does not exist.
    """
    from meshdeform.runs.devices import resolve_device, use_threads

    use_threads(settings.threads)
    device = resolve_device(settings.device)
    priors = PriorCache()

    def load_prior(model: str) -> Prior:
        revision = settings.model_revision if model == settings.model else ""
        return priors.get(model, device=device, revision=revision, dtype=settings.dtype)

    for kind in kinds():
        kind.load()  # now, so that the first job does not wait for it
    return Engine(start_run, load_prior, device)


class PriorCache:
    """A cache of one prior, the last one used, so that only one is in memory."""

    def __init__(self) -> None:
        self._key: tuple[str, str, str, str] | None = None
        self._prior: Prior | None = None

    def get(self, model: str, *, device: str, revision: str = "", dtype: str = "auto") -> Prior:
        """Return the prior `model`, loading it unless it is cached.

        Raises
        ------
        ModelError, DependencyError
            It cannot be loaded.
        """
        edition = _edition(model)
        key = (edition or model, device, revision, dtype)
        if self._prior is None or self._key != key:
            self._prior = None  # before the next one is loaded: two may not fit
            from meshdeform.priors import load_prior

            _log.info("loading the prior %s on %s", model, device)
            self._prior = load_prior(model, device=device, revision=revision, dtype=dtype)
            self._key = key
        return self._prior


def _edition(model: str) -> str:
    """Return the hash of taught weights, which may be replaced, or be elsewhere for each job; else an empty text."""
    if not is_taught(model):
        return ""
    path = Path(model).expanduser()
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            return ""
        with path.open("rb") as file:
            return f"{path.name} {hashlib.file_digest(file, 'sha256').hexdigest()}"
    except OSError:
        return ""
