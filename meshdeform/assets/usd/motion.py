"""Bring tracks of a clip to common times, between which USD interpolates linearly, rotations on the shorter arc."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from meshdeform.assets.clips import Clip, Floats, NodeTrack
from meshdeform.assets.container import Json

PATHS = ("translation", "rotation", "scale")
_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
_STEP = 1.0 / 60
"""Seconds between the values of a curve."""
_MOST = 5000
"""Values of a curve."""
_BEFORE = 1e-4
"""Seconds before a jump at which the value is still the old one."""


class Motion:
    """What one clip does to nodes; nothing without a clip."""

    def __init__(self, clip: Clip | None) -> None:
        self._tracks: dict[tuple[int, str], NodeTrack] = {}
        for track in clip.tracks if clip else ():
            self._tracks.setdefault((track.node, track.path), track)
        self.start, self.end = (clip.start, clip.end) if clip else (0.0, 0.0)

    def moves(self, node: int) -> bool:
        """Return whether the clip moves a node itself."""
        return any((node, path) in self._tracks for path in PATHS)

    def track(self, node: int, path: str) -> NodeTrack | None:
        """Return the track of a node's property; None if it does not change."""
        return self._tracks.get((node, path))

    def times(self, nodes: Sequence[int], path: str) -> list[float]:
        """Return the times at which these nodes' properties need values, in seconds; none if none changes."""
        found = [track for node in nodes if (track := self.track(node, path)) is not None]
        return sorted({float(time) for track in found for time in _needed(track)})

    def value(self, item: Json, node: int, path: str, seconds: float | None) -> Any:
        """Return the value (C,) of a node's property at a time; at rest for None, and if it does not change."""
        track = self.track(node, path)
        if track is None or seconds is None:
            return np.array(item.get(path, _REST[path]), np.float64)
        return track.at(seconds)


def _needed(track: NodeTrack) -> Floats:
    if track.mode == "STEP":
        return np.concatenate([track.times, track.times[1:] - _BEFORE])
    if track.mode == "CUBICSPLINE":
        length = float(track.times[-1] - track.times[0])
        count = int(min(max(np.ceil(length / _STEP), 1), _MOST))
        return np.concatenate([track.times, np.linspace(track.times[0], track.times[-1], count + 1)])
    return track.times
