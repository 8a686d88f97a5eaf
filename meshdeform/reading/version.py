"""Tell readings apart that different code has made.

The version is a digest of the sources of whatever a reading comes from, so that nobody has to remember to change it.
A change of words alone changes it as well, and costs that assets are read once more.
"""

from __future__ import annotations

from meshdeform.support.sources import digest_of

__all__ = ["MEMBERS_VERSION", "SOURCES", "VERSION"]

_OF_MEMBERS = ("nouns", "vocabulary", "words")
SOURCES = ("reading", *_OF_MEMBERS)
"""Folders and modules of the package on which readings depend."""

VERSION: str = digest_of(SOURCES)
"""Changes whenever the same asset may be read otherwise: 16 hexadecimal digits."""
MEMBERS_VERSION: str = digest_of(("reading/banks.py", "reading/samples.py", *_OF_MEMBERS))
"""Changes whenever the samples of a noun's members may be others."""
