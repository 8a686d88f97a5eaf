"""Insert rows by statements that are built once.

SQLAlchemy takes longer to build an insert of forty values, and to find that it has compiled the same one before, than
PostgreSQL to execute it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import sqlalchemy as sa

from meshdeform.record.database import Database

__all__ = ["NewRow", "insert"]


class NewRow(NamedTuple):
    """A row to be inserted, unless there is such a row if `unless_there`; values may be SQL expressions."""

    table: sa.Table
    values: Mapping[str, Any]
    unless_there: bool = False


_Shape = tuple[tuple[sa.Table, bool, tuple[tuple[str, Any], ...]], ...]


def insert(connection: sa.Connection, database: Database, row: NewRow, *others: NewRow) -> sa.Row[Any]:
    """Insert a row, and others that may refer to it; return the first as it is then.

    PostgreSQL does so in one statement, which takes one round trip.
    """
    if database.is_sqlite:
        found = connection.execute(sa.insert(row.table).values(row.values).returning(row.table)).one()
        for table, values, unless_there in others:
            one = database.upsert(table).values(values)
            connection.execute(one.on_conflict_do_nothing() if unless_there else one)
        return found
    shape: list[tuple[sa.Table, bool, tuple[tuple[str, Any], ...]]] = []
    parameters: dict[str, Any] = {}
    now, constant = database.now(), True
    for number, (table, values, unless_there) in enumerate((row, *others)):
        columns: list[tuple[str, Any]] = []
        for name, value in values.items():
            if isinstance(value, sa.ColumnElement):
                columns.append((name, value))
                constant = constant and value is now
            else:
                columns.append((name, None))
                parameters[_parameter(number, name)] = value
        shape.append((table, unless_there, tuple(columns)))
    statement = _kept(tuple(shape)) if constant else _built(tuple(shape))
    return connection.execute(statement, parameters).one()


def _parameter(number: int, name: str) -> str:
    return f"{name}_of_{number}"


def _built(shape: _Shape) -> Any:
    """Return PostgreSQL's statement for rows of these tables and columns, which have an expression or a parameter."""
    from sqlalchemy.dialects.postgresql import insert as insert_into

    made = []
    for number, (table, unless_there, columns) in enumerate(shape):
        values = {
            name: sa.bindparam(_parameter(number, name), type_=table.c[name].type) if given is None else given
            for name, given in columns
        }
        one = insert_into(table).values(values)
        made.append(one.on_conflict_do_nothing() if unless_there else one)
    first, *others = made
    return first.returning(shape[0][0]).add_cte(*(other.cte(f"also_{n}") for n, other in enumerate(others)))


_kept = lru_cache(maxsize=64)(_built)
