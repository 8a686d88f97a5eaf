"""Give the parts of two nouns like names, so that a wing can become an arm, and a tree's crown a mushroom's cap.

Small parts count with what carries them. A part that the other noun lacks takes the name of the first that plays its
role there; if none does, and it is not a limb of its own, it counts with the part from which it grows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from meshdeform.exemplar.kinds import is_figure, is_living

__all__ = ["LIMBS", "MANY", "TWO_SIDED", "grows_from", "large_parts", "made_alike"]

_SEATS = frozenset(("seat", "top", "mattress"))
_LIVING_LIMBS = frozenset(("neck", "head", "trunk", "body"))


def _table(lines: str) -> dict[str, tuple[str, ...]]:
    """Return the words before each colon with those behind it."""
    pairs = (line.partition(":") for line in lines.split("\n") if line.strip())
    return {word: tuple(right.split()) for left, _, right in pairs for word in left.split()}


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_COUNTS_WITH = _table("""
    foot heel sole: leg shaft
    hand claw: arm
    eye fang mouth tooth cheek wattle crest beard hair halo hat visor: head body
    shield staff weapon: hand arm body
    finger thumb cuff: hand arm body
    button knob key pedal peg line text seal lock hole bridge cut cross boss belt pocket collar bow: body
    panel plank band hoop door window drawer book shelf tap lamp bumper exhaust plough finder jewel rim: body
    cheese lettuce sauce patty sausage seed: bun body
    icing candle cherry wick plate: body cream
    pillow blanket footboard: mattress frame
    house lantern: tower
    periscope cap point: tower crown body
    propeller axle: body
    step rail face perch bracket: body top base
    water: dish basin
    nut: crown leaf trunk
    rope: basket
    guard: handle
    flap: body
    stand fork clapper roller: body
    cabin load ladder: body
    bellows cone land needle ring stick string trigger: body head
    page: cover body
    step: frame body
""")
"""The parts that are too small for maps of their own, and what they count with: the first that the noun has."""

_LIVING_ROLES = _table("""
    nose: beak trunk jaw
    beak: nose trunk
    trunk: nose beak
    jaw: nose beak
    arm: wing fin
    wing: arm fin
    fin: wing arm
    foot: leg
    leg: foot
    hand: arm wing
    ear: horn feeler
    horn: ear feeler
    feeler: ear horn
    mane: plume
    tail: fin
    shell: body
    body: shell
""")
_OTHER_ROLES = _table("""
    stem: trunk handle mast pole shaft rope
    trunk: stem handle mast
    handle: stem trunk neck shaft
    mast: trunk stem pole
    pole: mast stem column
    column: pole leg
    basin: dish body
    dome: roof crown
    chute: seat
    shaft: body stem skirt
    crown: cap canopy shade leaf cream head
    cap: crown canopy shade cream head
    canopy: crown cap shade
    shade: crown cap canopy flame
    cream: crown cap
    leaf: crown cap
    head: blade weight crown cap body
    blade: head weight body
    weight: head blade
    flame: shade crown
    seat: top mattress frame body
    top: seat mattress body
    mattress: seat top body
    frame: body seat
    body: seat top frame tower base skirt shaft screen head crown cap sail cover
    cover: body seat top
    skirt: body shaft
    screen: body
    tower: keep mast
    keep: tower
    roof: top canopy
    rotor: sail propeller
    sail: rotor wing
    arm: handle branch
    branch: arm handle
    spout: handle nose
    nose: spout
    wheel: track skid
    track: wheel
    skid: wheel track
    wing: fin sail
    fin: wing
    turret: cabin tower
    cabin: turret house
    sleeve: strap arm
    strap: sleeve handle
    neck: handle lid
    lid: neck cap
    base: dish foot body
    dish: base
    basket: base body
    tank: back body
    back: tank
""")
_GROWS_FROM = _table("""
    nose beak jaw tusk horn ear mane plume feeler fang: head neck body
    head: neck body tower handle stem
    neck: head body
    mane: neck head body
    arm wing leg fin tail spike hump shell: body seat top mattress frame head
    body: seat top mattress frame stem base head
    seat top: body frame
    mattress: frame seat body
    frame: body seat mattress
    back arm: seat top mattress body frame
    cabin load turret gun chimney roof tower keep mast sail track skid rotor wheel: body tower
    crown cap canopy shade leaf branch cream flame: stem trunk body
    stem trunk: head body crown cap
    base dish: stem body tower column
    handle spout lid neck: body blade head
    sleeve strap skirt shaft brim: body
    blade weight grip lens: body handle
    basket: rope body
    dome: body
""")
"""The parts of either noun from which one grows that the other lacks."""

_SWELLINGS = _words("""
    nose beak jaw mane plume spike hump shell cabin load roof chimney keep lid brim cap point cream mattress frame
    screen skirt shaft stand neck tank back body seat top head tower
""")
"""Parts that are not limbs: where the other noun has none, they count with what they grow from."""

LIMBS = _words(
    "neck tail nose trunk beak ear horn arm wing leg fin handle spout stem mast pole feeler gun branch blade"
)
"""Parts that may be longer than wide, and turn with their axes."""
MANY = _words(
    "leg arm ear horn wing wheel fin sleeve strap weight tower handle leaf finger track skid pole branch feeler roller"
)
"""Parts that may be in several pieces; what is of another part is one piece."""
TWO_SIDED = _words("leg arm ear horn wing sleeve strap track skid feeler")
"""Parts that are left or right of the middle."""


def made_alike(
    source: Iterable[str], goal: Iterable[str], source_noun: str, goal_noun: str
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the name by which each part of a source, and of its goal, is known to both.

    Names that are in both are those that can be matched. Legs of what becomes a figure without any, such as a snowman,
    count with its body.
    """
    living = is_living(source_noun) and is_living(goal_noun)
    one = _small_with_large(set(source))
    other = _small_with_large(set(goal))
    roles = _LIVING_ROLES if living else _OTHER_ROLES
    _take_roles(one, other, roles)
    _take_roles(other, one, roles)
    _fold(one, other, living, figure=is_figure(goal_noun))
    _fold(other, one, living)
    return one, other


def _small_with_large(parts: set[str]) -> dict[str, str]:
    """Return the name of each part: its own, or, of small ones, that of the part on which they are."""
    names = {}
    for part in sorted(parts):
        name = part
        while name in _COUNTS_WITH:
            above = next((base for base in _COUNTS_WITH[name] if base in parts and base != name), None)
            if above is None:
                break
            name = above
        names[part] = name
    return names


def _take_roles(own: dict[str, str], other: Mapping[str, str], roles: Mapping[str, tuple[str, ...]]) -> None:
    """Rename what only one has by what only the other has, in place."""
    for name in sorted(set(own.values()) - set(other.values())):
        free = set(other.values()) - set(own.values())
        role = next((role for role in roles.get(name, ()) if role in free), None)
        if role is not None:
            _rename(own, name, role)


def _fold(own: dict[str, str], other: Mapping[str, str], living: bool, *, figure: bool = False) -> None:
    """Let what only one has, and is no limb, count with what it grows from, in place."""
    for name in sorted(set(own.values()) - set(other.values())):
        matched = set(own.values()) & set(other.values())
        limb = name not in _SWELLINGS or (living and name in _LIVING_LIMBS)
        joined = (name == "arm" and not living and bool(matched & _SEATS)) or (name == "leg" and figure)
        if limb and not joined:
            continue
        base = grows_from(name, matched)
        if base is not None:
            _rename(own, name, base)


def _rename(names: dict[str, str], old: str, new: str) -> None:
    for part, name in names.items():
        if name == old:
            names[part] = new


def large_parts(parts: Iterable[str]) -> set[str]:
    """Return those parts that do not count with others."""
    return set(parts) - set(_COUNTS_WITH)


def grows_from(part: str, present: Iterable[str]) -> str | None:
    """Return the part, of those present, from which one grows, or None if none of them is known to carry it."""
    here = set(present)
    return next((base for base in _GROWS_FROM.get(part, ("body",)) if base in here), None)
