"""Remember what was asked about the last assets of a process: the noun that one is taken for, and its front.

Another prompt for the same asset then waits for neither. The answers are those of a new process, bit for bit: each
question has a seed of its own, and its key holds all that it depends on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from meshdeform.deformation.checkpoint import fingerprint
from meshdeform.deformation.orientation import Front, Orientation, OrientationSource
from meshdeform.priors.base import Prior
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.recent import Recent
from meshdeform.runs.recognition import Recognition

_LATER = {"steps", "preset", "learning_rate"}
"""Parameters of the optimisation alone: a draft answers for the final run."""
_ANSWERS = {OrientationSource.FOUND, OrientationSource.UNDECIDED, OrientationSource.UNCONDITIONED}


NOUNS: Recent[Recognition] = Recent()
FRONTS: Recent[Orientation] = Recent()


def recognised_again(key: str, ask: Callable[[], Recognition | None]) -> Recognition | None:
    """Return the noun of an asset, and ask for it only once."""
    answer = NOUNS.get(key) or ask()
    if answer is not None:
        NOUNS.put(key, answer)
    return answer


def asset_key(shape: str, params: ResolvedParams, prior: Prior | None) -> str:
    """Return what the answers about an asset depend on: its shape and file, the prior, and how it is drawn."""
    values = {name: value for name, value in params.model_dump(mode="json").items() if name not in _LATER}
    return fingerprint(shape=shape, params=values, prior=None if prior is None else prior.identity)


def front_again(key: str, front: Front | None, source: Recognition | None) -> tuple[Front | None, str]:
    """Return a front with the answer that is known, and the key of that."""
    key = fingerprint(asset=key, nouns=None if source is None else source.likely())
    return (front if front is None or front.grader is None else replace(front, known=FRONTS.get(key))), key


def keep_front(key: str, orientation: Orientation) -> None:
    """Remember an orientation that was searched."""
    if orientation.source in _ANSWERS:
        FRONTS.put(key, orientation)
