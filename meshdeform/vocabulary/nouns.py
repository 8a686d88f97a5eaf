"""List the nouns that have shapes, their groups, traits, settable parts and other names, as `nouns.txt` has them.

It needs neither numpy nor torch: the service checks a prompt before it accepts the job.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = [
    "AFLOAT",
    "HELD",
    "LENGTH",
    "NOUNS",
    "NOUN_GROUPS",
    "PARTS",
    "ROUND",
    "SIZE",
    "SYNONYMS",
    "TABLE",
    "Noun",
    "nouns_with",
]

LENGTH, SIZE = ("short", "long"), ("small", "big")
_LENGTHS = (
    "arms back beak beard blade chimney columns feelers gun handle hat heel horns leaves legs lens neck nose "
    "sleeves spikes spout stem tail tower trunk tusks"
)
_SIZES = "brim cap claws crown dome ears eyes fins head humps mane roof sail shade shell wheels wings"
PARTS: dict[str, tuple[str, str]] = dict(
    sorted([*((part, LENGTH) for part in _LENGTHS.split()), *((part, SIZE) for part in _SIZES.split())])
)
"""Every part whose size a prompt can set, with its two degrees, the lesser and the greater."""


@dataclass(frozen=True)
class Noun:
    """A noun: its group, its traits, the parts whose size a prompt can set, and its other names.

    `solids`: the names of the parts that its family draws, with a question mark behind those that some members lack;
    empty where `solids.LAYOUTS` has them.
    """

    name: str
    group: str
    traits: tuple[str, ...]
    parts: tuple[str, ...]
    synonyms: tuple[str, ...]
    solids: tuple[str, ...] = ()


def _read(text: str) -> dict[str, Noun]:
    """Read the table, in its order."""
    nouns: dict[str, Noun] = {}
    group = ""
    for line in text.splitlines():
        if line.startswith("["):
            group = line.strip("[]")
        elif line and not line.startswith("#"):
            name, *columns = line.split("|")
            nouns[name.strip()] = Noun(name.strip(), group, *(tuple(column.split()) for column in columns))
    return nouns


_by_group = _read((Path(__file__).parent / "nouns.txt").read_text(encoding="utf-8"))
TABLE: dict[str, Noun] = dict(sorted(_by_group.items()))
"""All nouns, by the alphabet."""
NOUNS: dict[str, tuple[str, ...]] = {name: noun.parts for name, noun in TABLE.items()}
"""Every noun with the parts whose size a prompt can set."""
NOUN_GROUPS: dict[str, tuple[str, ...]] = {
    group: tuple(name for name, noun in TABLE.items() if noun.group == group)
    for group in dict.fromkeys(noun.group for noun in _by_group.values())
}
"""The nouns by kind, for people who choose one."""
SYNONYMS: dict[str, str] = {other: name for name, noun in TABLE.items() for other in noun.synonyms}
"""The noun that each other name means."""


def nouns_with(trait: str) -> frozenset[str]:
    """Return the nouns that have a trait."""
    return frozenset(name for name, noun in TABLE.items() if trait in noun.traits)


ROUND = nouns_with("round")
"""The nouns of what is alike from all four sides."""
AFLOAT = nouns_with("afloat")
"""What does not stand on the ground."""
HELD = nouns_with("held")
"""What may lie, or stand on its head."""
