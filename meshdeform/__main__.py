"""``python -m meshdeform``."""

from meshdeform.cli.app import main

main()
