"""Decide before the first step how the cameras turn and what structure of a mesh is kept. States of a run have both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

from numpy.typing import NDArray

from meshdeform.deformation.orientation import Orientation, OrientationSource
from meshdeform.deformation.settings import Carrier, GuidanceKind, OrientationMode, RunSettings
from meshdeform.deformation.stand_in import chosen_carrier
from meshdeform.deformation.structure import Nature, Structure, structure_of
from meshdeform.geometry.mesh import RestMesh

__all__ = ["Decided", "decide", "stored_structure"]

_ORIENTATION, _STRUCTURE = "orientation", "structure"
_State = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Decided:
    """What is decided of a mesh.

    `orientation`: the turn of the cameras. `structure`: what few degrees of freedom keep; None if every element has its
    own Jacobian.
    """

    orientation: Orientation
    structure: Structure | None

    @classmethod
    def stored(cls, state: _State) -> Self:
        """Return what is in the tensors of a checkpoint."""
        return cls(_stored_orientation(state), stored_structure(state))

    @classmethod
    def continued(cls, state: _State, mode: OrientationMode | float) -> Self:
        """Return what a run decides that starts with the shape of a checkpoint's tensors.

        Only the same structure can represent its shape.
        """

        def front() -> Orientation:
            return replace(_stored_orientation(state), source=OrientationSource.CONTINUED)

        return cls(_turned(mode, front), stored_structure(state))

    def to_state(self) -> dict[str, NDArray[Any]]:
        """Return the tensors of a checkpoint from which `stored` reads it."""
        state: dict[str, NDArray[Any]] = {_ORIENTATION: self.orientation.to_array()}
        return state if self.structure is None else {**state, _STRUCTURE: self.structure.to_array()}


def decide(
    params: RunSettings,
    mesh: RestMesh,
    shown: RestMesh,
    front: Orientation,
    nature: Nature,
    *,
    rigid: bool,
    local: bool,
) -> Decided:
    """Return what is decided of a mesh at rest.

    `shown`: the mesh or its stand-in; `front` and `nature`: what is known of it; `rigid`: whether it has bodies that
    keep their shape; `local`: whether a loss reaches a part of it alone.
    """
    orientation = _turned(params.orientation, lambda: front)
    # A prompt says little of a shape, so few degrees of freedom have all the freedom that it can use; a target says
    # all, and a loss for a region reaches its elements alone.
    few = params.carrier is Carrier.AUTO and params.guidance is GuidanceKind.SDS and not local
    if not few:
        return Decided(orientation, None)
    if not params.keep_structure:
        return Decided(orientation, Structure())
    several = chosen_carrier(params.carrier, mesh, rigid=rigid) is Carrier.LATTICE
    return Decided(orientation, structure_of(shown, nature, orientation.turn_deg, several=several))


def stored_structure(state: _State) -> Structure | None:
    """Return the structure in a checkpoint's tensors."""
    structure = state.get(_STRUCTURE)
    return None if structure is None else Structure.from_array(structure)


def _stored_orientation(state: _State) -> Orientation:
    return Orientation.from_array(state[_ORIENTATION])


def _turned(mode: OrientationMode | float, front: Callable[[], Orientation]) -> Orientation:
    """Return the turn of the cameras: as given, none, or to the front."""
    if not isinstance(mode, OrientationMode):
        return Orientation(mode, OrientationSource.GIVEN)
    return Orientation() if mode is OrientationMode.KEEP else front()
