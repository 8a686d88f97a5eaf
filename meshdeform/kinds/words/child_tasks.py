"""What child processes do for words of one's own."""

from __future__ import annotations

TASKS = {
    "word": "meshdeform.kinds.words.process:make_given",
    "word_picture": "meshdeform.kinds.words.process:draw_given",
}
