"""What child processes do for drawings."""

from __future__ import annotations

TASKS = {
    "drawing": "meshdeform.kinds.sketch.process:read_drawing",
    "sketch": "meshdeform.kinds.sketch.process:make_shape",
}
