"""The prior of a worker: loaded once, kept between jobs."""

from __future__ import annotations

import logging

from meshdeform.priors import load_prior
from meshdeform.priors.base import Prior

__all__ = ["PriorCache"]

_log = logging.getLogger(__name__)


class PriorCache:
    """Keeps the prior that was used last; another one takes its place, so only one is ever in memory."""

    def __init__(self) -> None:
        self._key: tuple[str, str, str] | None = None
        self._prior: Prior | None = None

    def get(self, model: str, *, device: str, revision: str = "") -> Prior:
        """The prior `model`, loaded unless it is the one at hand.

        Raises
        ------
        ModelError, DependencyError
            It cannot be loaded.
        """
        key = (model, device, revision)
        if self._prior is None or self._key != key:
            self._prior = None  # before the next one is loaded: two may not fit
            _log.info("loading the prior %s on %s", model, device)
            self._prior = load_prior(model, device=device, revision=revision)
            self._key = key
        return self._prior
