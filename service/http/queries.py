"""Refuse query parameters that a route does not have, instead of ignoring a misspelt one."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import Depends, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute

from service.http.errors import did_you_mean, parameter_error

__all__ = ["KNOWN_QUERY"]

_SHOWN = 64


async def _known_query(request: Request) -> None:
    """Refuse an unknown query parameter, if the caller may ask at all, and name the one that was probably meant."""
    if not request.query_params or "signature" in request.query_params:
        return  # a signature covers the whole query, and opens nothing else
    known = set(_names(request.scope["route"]))
    errors = [
        {
            "loc": ["query", name[:_SHOWN]],
            "msg": did_you_mean(name[:_SHOWN], known, known, "parameter"),
            "type": "extra_forbidden",
        }
        for name in list(request.query_params)[:_SHOWN]
        if name.partition("[")[0] not in known
    ]
    if errors:
        await request.app.state.gate.admit(request)  # without a key, say nothing but that one is needed
        raise parameter_error(errors)


def _names(route: APIRoute) -> Iterator[str]:
    """Yield the names of a route's query parameters."""
    todo: list[Dependant] = [route.dependant]
    while todo:
        dependant = todo.pop()
        yield from (parameter.alias for parameter in dependant.query_params)
        todo += dependant.dependencies
    for parameter in (route.openapi_extra or {}).get("parameters", []):
        if parameter["in"] == "query":
            yield parameter["name"]


KNOWN_QUERY = [Depends(_known_query)]
"""The dependencies of every router under `/v1`."""
