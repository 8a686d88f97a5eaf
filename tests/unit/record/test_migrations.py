"""Migrations only add, so that processes of the version before can go on: see `meshdeform.record.schema.compatible`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import alembic.command
import alembic.config
import sqlalchemy as sa
from alembic.script import ScriptDirectory

import meshdeform.record
from meshdeform.record.database import make_engine
from meshdeform.record.schema import HEAD, compatible
from tests.cases import each_case
from tests.newer_version import NEWER

Schema = dict[str, dict[str, dict[str, Any]]]


def schema(connection: sa.Connection) -> Schema:
    """The columns of all tables, by their names."""
    found = sa.inspect(connection)
    return {
        table: {column["name"]: dict(column) for column in found.get_columns(table)}
        for table in found.get_table_names()
    }


def broken(before: Schema, after: Schema) -> list[str]:
    """What a program that knows the schema before can no longer do."""
    wrong = [f"{table} is gone" for table in before if table not in after]
    for table in before.keys() & after.keys():
        old, new = before[table], after[table]
        wrong += [f"{table}.{name} is gone" for name in old if name not in new]
        for name, column in new.items():
            required = not column["nullable"] and column["default"] is None
            if name not in old and required:
                wrong.append(f"{table}.{name} must be written")
            elif name in old and required and old[name]["nullable"]:
                wrong.append(f"{table}.{name} may no longer be null")
            elif name in old and str(column["type"]) != str(old[name]["type"]):
                wrong.append(f"{table}.{name} has another type")
    return sorted(wrong)


def config() -> alembic.config.Config:
    made = alembic.config.Config()
    made.set_main_option("script_location", str(Path(meshdeform.record.__file__).parent / "migrations"))
    return made


def test_every_migration_of_a_generation_only_adds(tmp_path: Path) -> None:
    revisions = [script.revision for script in ScriptDirectory.from_config(config()).walk_revisions()][::-1]
    assert revisions == sorted(revisions)
    assert revisions[-1] == HEAD
    first = Path(meshdeform.record.__file__).parent / "migrations/versions" / f"{revisions[0]}_tables.py"
    assert len(revisions) == 1 or "create_all" not in first.read_text(), "the tables of today are not those of then"
    engine, settings = make_engine(f"sqlite:///{tmp_path}/record.sqlite"), config()
    with engine.begin() as connection:
        settings.attributes["connection"] = connection
        alembic.command.upgrade(settings, revisions[0])
        before, version = schema(connection), revisions[0]
        for revision in revisions[1:]:
            alembic.command.upgrade(settings, revision)
            after = schema(connection)
            if revision[:2] == version[:2]:
                assert broken(before, after) == [], f"{revision}: what does not only add begins a generation, 0100"
            before, version = after, revision
    engine.dispose()


def test_what_breaks_the_version_before_is_found() -> None:
    """What `broken` says of a change, so that the test above cannot pass for nothing."""
    engine = sa.create_engine("sqlite://")
    with engine.begin() as connection:
        for statement in ("CREATE TABLE a (x INTEGER NOT NULL, z TEXT)", "CREATE TABLE b (x INTEGER)"):
            connection.execute(sa.text(statement))
        before = schema(connection)
        for statement in ("ALTER TABLE a ADD COLUMN c TEXT", "CREATE TABLE c (x INTEGER NOT NULL)"):
            connection.execute(sa.text(statement))
        assert broken(before, schema(connection)) == []
        for statement in ("DROP TABLE b", "DROP TABLE a", "CREATE TABLE a (x TEXT, y TEXT NOT NULL, z TEXT NOT NULL)"):
            connection.execute(sa.text(statement))
        assert broken(before, schema(connection)) == [
            "a.x has another type",
            "a.y must be written",
            "a.z may no longer be null",
            "b is gone",
        ]
    engine.dispose()


@each_case(
    ("version", "usable"),
    [(HEAD, True), (NEWER, True), ("0001", False), ("0100", False), ("9999", False), (None, False)],
)
def test_a_record_can_be_used_if_nothing_was_taken_away(version: str | None, usable: bool) -> None:
    assert compatible(version) is usable
