"""Words of one's own: make them of meshes, and keep, show and share them.

`making` makes a word, `shapes` its shapes, `process` both in a child; `commands` and `routes` are what people use. What
a word is and which are in use is `meshdeform.words`, which reads prompts with them.
"""

NAMES = ()
