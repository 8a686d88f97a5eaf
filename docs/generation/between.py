"""Replace the generated part of a page, between two comments; the rest is written by hand."""

from __future__ import annotations

__all__ = ["END", "begin", "renewed"]

END = "<!-- until here -->\n"


def begin(source: str) -> str:
    """Return the comment at the beginning of the generated part."""
    return f"<!-- from {source}, by python docs/generate.py -->\n"


def renewed(text: str, source: str, part: str) -> str:
    """Return a page with its generated part replaced.

    Parameters
    ----------
    text : str
        The current page.
    source : str
        What the part is generated from.
    part : str
        New text between the comments.

    Raises
    ------
    ValueError
        The comments are missing.
    """
    before, opening, rest = text.partition(begin(source))
    _, closing, after = rest.partition(END)
    if not (opening and closing):
        raise ValueError(f"the comments around the part generated from {source} are missing")
    return f"{before}{opening}\n{part}\n{closing}{after}"
