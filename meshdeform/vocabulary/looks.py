"""Say what words for the look of a whole do: to all of it, or to which of its parts."""

from __future__ import annotations

__all__ = ["LOOKS", "SHAPES"]

SHAPES: dict[str, str] = {
    "boxy": "filled out toward its box",
    "rounded": "drawn in toward an ellipsoid",
}
"""Adjectives of the whole that shapes take and the prior does not know, with their effects."""

LOOKS: dict[str, str] = {
    **dict.fromkeys(
        ("cartoon", "cartoonish", "comic", "cute", "chibi", "toy"), "big head, short legs, short arms, big eyes; fat"
    ),
    **dict.fromkeys(("baby", "young"), "big head, short legs, short arms"),
    **dict.fromkeys(("stocky", "chunky", "sturdy"), "fat, short legs, short neck"),
    **dict.fromkeys(("lanky", "gangly", "leggy"), "thin, long legs, long arms, long neck"),
    **dict.fromkeys(("sleek", "streamlined"), "thin, long"),
    **dict.fromkeys(("bulky", "massive", "burly"), "fat, wide"),
    **dict.fromkeys(("sporty", "sports", "racing"), "short, long, big wheels"),
    **dict.fromkeys(("offroad", "off-road", "monster"), "big wheels"),
    **dict.fromkeys(("boxy", "square", "angular", "cubic", "blocky"), "boxy"),
    **dict.fromkeys(("rounded", "spherical", "bulbous", "ball-shaped"), "rounded"),
    **dict.fromkeys(("conical", "cone-shaped"), "tapered"),
    **dict.fromkeys(("curvy", "shapely"), "pinched"),
}
"""What each word gives, an attribute a piece; those of parts that a noun lacks do not count.

After a semicolon stands what it gives a noun that has none of those parts.
"""
