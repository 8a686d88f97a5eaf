"""Assets that were checked before: a studio posts one asset with many prompts, and it is decoded once.

Only what passed is remembered, by the SHA-256 of the bytes: what is known of a file never changes, as the limits of a
process do not, either.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from pathlib import PurePath

from meshdeform.assets import Limits, check_asset_subprocess
from meshdeform.assets.inspect import AssetSummary
from service.http.multipart import ReceivedFile

__all__ = ["CheckedAssets"]

_REMEMBERED = 512


class CheckedAssets:
    """Checks files, each once.

    Parameters
    ----------
    limits : Limits
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._passed: OrderedDict[tuple[str, str], AssetSummary] = OrderedDict()
        self._lock = threading.Lock()

    def check(self, file: ReceivedFile) -> AssetSummary:
        """Check a file from its JSON to its last vertex, or remember that it passed.

        Raises
        ------
        AssetError, DependencyError
            What is wrong with it.
        """
        # The name's ending says how some formats are read.
        known = (file.sha256, PurePath(file.filename).suffix.lower())
        with self._lock:
            if known in self._passed:
                self._passed.move_to_end(known)
                return self._passed[known]
        summary = check_asset_subprocess(file.path, file.filename, self._limits)
        with self._lock:
            self._passed[known] = summary
            if len(self._passed) > _REMEMBERED:
                self._passed.popitem(last=False)
        return summary
