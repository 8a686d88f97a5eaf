"""Read stored documents without bounds, which are checked at the door alone. Torch-free."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import SchemaValidator

__all__ = ["first_problem", "read_unbounded"]

M = TypeVar("M", bound=BaseModel)
_BOUNDS = frozenset({"ge", "gt", "le", "lt", "multiple_of", "ref"})
_LENGTHS = frozenset({"min_length", "max_length"})


def read_unbounded(model: type[M], document: Mapping[str, Any]) -> M:
    """Read a document that was within the bounds of the edition that accepted it.

    Only the bounds of numbers and lengths are left out. Unknown members and values, wrong types, and members that
    contradict each other are refused as ever: nobody knows what they mean.

    Parameters
    ----------
    document : mapping
        Of JSON, or of members that are read already.

    Raises
    ------
    ValidationError
        It cannot be read as such a model.
    """
    read: M = _validator(model).validate_python(document)
    return read


def first_problem(error: ValidationError, *within: str) -> str:
    """Return the first problem of a document, which is itself `within` another one, after the place where it is."""
    problem = error.errors(include_url=False, include_context=False, include_input=False)[0]
    place = ".".join(map(str, (*within, *problem["loc"])))
    unknown = problem["type"] == "extra_forbidden"
    said = "there is no such member" if unknown else problem["msg"].removeprefix("Value error, ")
    return f"{place}: {said}" if place else said


@cache
def _validator(model: type[BaseModel]) -> SchemaValidator:
    return SchemaValidator(_without_bounds(model.__pydantic_core_schema__, {}))


def _without_bounds(node: Any, shared: dict[str, Any]) -> Any:
    """Return a part of pydantic's core schema, which is made of dicts and lists, without its bounds.

    `shared` has the parts that others refer to.
    """
    if isinstance(node, list):
        return [_without_bounds(each, shared) for each in node]
    if not isinstance(node, dict):
        return node
    left_out: frozenset[str] = frozenset()
    # Other dicts have names of members for keys.
    if isinstance(kind := node.get("type"), str):
        if kind == "definitions":
            shared = {**shared, **{each["ref"]: each for each in node["definitions"]}}
            return _without_bounds(node["schema"], shared)
        if kind == "definition-ref":
            return _without_bounds(shared[node["schema_ref"]], shared)
        if kind == "model":
            return {"type": "function-plain", "function": {"type": "no-info", "function": _reader(node, shared)}}
        # A length that is fixed is a shape, and no bound.
        fixed = "min_length" in node and node["min_length"] == node.get("max_length")
        left_out = _BOUNDS if fixed else _BOUNDS | _LENGTHS
    return {name: _without_bounds(each, shared) for name, each in node.items() if name not in left_out}


def _reader(node: dict[str, Any], shared: dict[str, Any]) -> Callable[[Any], Any]:
    """Return a function that reads a model by its members, since pydantic would use the model's own validator."""
    members = SchemaValidator(_without_bounds(node["schema"], shared), node.get("config"))
    model: type[BaseModel] = node["cls"]

    def read(value: Any) -> Any:
        if isinstance(value, model):
            return value
        values, _, written = members.validate_python(value)
        return model.model_construct(written, **values)

    return read
