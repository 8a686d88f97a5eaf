"""Many cases in one test: all of them run, and each that fails is reported under its own name."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import Any

__all__ = ["each_case"]

_FIXTURE = "subtests"


def each_case(
    names: str | Sequence[str],
    cases: Iterable[Any] | Callable[[], Iterable[Any]],
    *,
    ids: Iterable[str] | Callable[[Any], str | None] | None = None,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run a test once for every case without making each case a test of its own.

    It is written like `pytest.mark.parametrize`. The difference is that the fixtures are made once and shared by all
    cases, so use it where a case leaves nothing behind that the next one would see. Cases that take time to find are
    those of a function, which is called when the test runs. A test without cases would pass without having run:
    ValueError.
    """
    wanted = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    if ids is not None and not callable(ids):
        ids = list(ids)
    known = None if callable(cases) else _table(cases, wanted)

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        signature = inspect.signature(test)
        others = [parameter for name, parameter in signature.parameters.items() if name not in wanted]
        within = _FIXTURE in signature.parameters  # of another `each_case`, or of the test itself
        if not within:
            others.append(inspect.Parameter(_FIXTURE, inspect.Parameter.KEYWORD_ONLY))

        @functools.wraps(test)
        def over_all_cases(**fixtures: Any) -> None:
            subtests = fixtures[_FIXTURE] if within else fixtures.pop(_FIXTURE)
            table = _table(cases(), wanted) if callable(cases) else known or []
            labels = _labels(table, ids)  # here, because every worker of the tests imports every file
            for label, values in zip(labels, table, strict=True):
                with subtests.test(label):
                    test(**fixtures, **dict(zip(wanted, values, strict=True)))

        over_all_cases.__signature__ = signature.replace(parameters=others)  # type: ignore[attr-defined]
        return over_all_cases

    return decorate


def _table(cases: Iterable[Any], wanted: Sequence[str]) -> list[tuple[Any, ...]]:
    table = [_values(case, len(wanted)) for case in cases]
    if not table:
        raise ValueError(f"no cases for {', '.join(wanted)}")
    return table


def _values(case: Any, count: int) -> tuple[Any, ...]:
    return (case,) if count == 1 else tuple(case)


def _labels(table: list[tuple[Any, ...]], ids: Iterable[str] | Callable[[Any], str | None] | None) -> list[str]:
    if ids is None:
        return [", ".join(_short(value) for value in values) for values in table]
    if callable(ids):
        return [", ".join(ids(value) or _short(value) for value in values) for values in table]
    return [str(label) for label in ids]


def _short(value: Any) -> str:
    text = getattr(value, "__name__", None) or repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
