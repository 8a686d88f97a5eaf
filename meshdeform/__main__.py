"""``python -m meshdeform``."""

from meshdeform.cli import main

main()
