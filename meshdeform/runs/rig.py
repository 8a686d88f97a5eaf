"""Say what a rig that stayed as it was means for the result."""

from __future__ import annotations

from meshdeform.assets.parts import Rig
from meshdeform.requests.choices import RigMode

__all__ = ["rig_warnings"]


def rig_warnings(rig: Rig, mode: RigMode) -> list[str]:
    """Return a sentence about morph targets and joints that did not follow the shape, if there are any."""
    if mode is RigMode.FOLLOW or not rig:
        return []
    counted = [(rig.joints, "joint"), (rig.morph_targets, "morph target")]
    what = " and ".join(f"{count} {name}{'s' if count > 1 else ''}" for count, name in counted if count)
    return [
        f"The asset has {what}, which stayed as they were: output.rig is keep. "
        "Set it to follow, so that the result animates as the source does."
    ]
