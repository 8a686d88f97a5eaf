"""Check what a service needs: Redis, the record, the object store and workers."""

from __future__ import annotations

import sqlite3
import subprocess
import tempfile
import time
import uuid
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlsplit

from meshdeform.cli.diagnosis.checks import Finding, Subject, fail, ok, skip, warn
from meshdeform.cli.diagnosis.machine import nearest
from meshdeform.errors import MeshdeformError

if TYPE_CHECKING:
    import sqlalchemy as sa

__all__ = ["check_database", "check_redis", "check_store", "check_workers"]

_NO_EXTRA = "the extra service is not installed"
_STORE_ADVICE = (
    "Check that it runs, that the bucket of MESHDEFORM_STORAGE_URL exists, and that the credentials in the environment "
    "may read, write and delete there; docs/storage.md lists the variables."
)


def check_redis(subject: Subject) -> Iterator[Finding]:
    """Check the configured Redis, else the program that `serve` would start."""
    if find_spec("redis") is None:
        yield skip("redis", _NO_EXTRA)
        return
    if not subject.settings.redis_url:
        from meshdeform.serving.redis_server import find_redis_server

        program = find_redis_server()
        done = subprocess.run(
            [program, "--version"], capture_output=True, text=True, check=False, timeout=subject.timeout_s
        )
        if done.returncode != 0:
            yield fail("redis", f"{program} does not start: {done.stderr.strip()}", "Install another redis-server.")
        else:
            yield ok("redis", f"`serve` starts {program} ({_redis_version(done.stdout)})")
        return
    yield from _configured_redis(subject)


def _configured_redis(subject: Subject) -> Iterator[Finding]:
    from redis import Redis
    from redis.backoff import NoBackoff
    from redis.exceptions import RedisError
    from redis.retry import Retry

    url, limit = subject.settings.redis_url, subject.timeout_s
    try:
        with Redis.from_url(
            url, socket_connect_timeout=limit, socket_timeout=limit, retry=Retry(NoBackoff(), 0)
        ) as redis:
            before = time.time()
            seconds, micro = redis.time()
            subject.skews_s["Redis"] = seconds + micro / 1e6 - (before + time.time()) / 2
            facts: dict[str, Any] = redis.info()
    except ValueError:
        yield fail("redis", "MESHDEFORM_REDIS_URL is not a Redis URL", "Use redis://host:6379/0 or unix:///path.")
        return
    except (RedisError, OSError) as error:
        advice = "Start it, or correct MESHDEFORM_REDIS_URL; if it is unset, `serve` starts its own Redis."
        yield fail("redis", f"{_where(url)} does not respond: {error}", advice)
        return
    detail = f"{facts.get('redis_version', '?')} at {_where(url)}"
    if facts.get("maxmemory", 0) and facts.get("maxmemory_policy") != "noeviction":
        advice = "Set maxmemory-policy noeviction: jobs that Redis drops wait until the reconciler queues them again."
        yield warn("redis", f"{detail} may drop queued jobs ({facts['maxmemory_policy']})", advice)
    else:
        yield ok("redis", detail)


def check_database(subject: Subject) -> Iterator[Finding]:
    """Check that the record responds, is writable and has the newest schema; migrate nothing."""
    if find_spec("sqlalchemy") is None:
        yield skip("database", _NO_EXTRA)
        return
    import sqlalchemy as sa

    url = subject.settings.resolved_database_url
    if url.startswith("sqlite"):
        yield _sqlite(Path(sa.make_url(url).database or ""), subject.timeout_s)
        return
    from meshdeform.record.database import make_engine

    # The same engine as the record's, with its driver and TLS, but without migrations.
    engine = make_engine(url)
    try:
        with engine.connect() as connection:
            yield _database_finding(connection, engine.url, subject)
    except sa.exc.SQLAlchemyError as error:
        first = str(getattr(error, "orig", error)).splitlines()[0]
        yield fail(
            "database", f"{_where(url)} does not respond: {first}", "Start it, or correct MESHDEFORM_DATABASE_URL."
        )
    finally:
        engine.dispose()


def _sqlite(path: Path, timeout_s: float) -> Finding:
    if not path.exists():
        folder = nearest(path.parent)
        try:
            with tempfile.TemporaryFile(dir=folder):
                return ok("database", f"{path} will be created at the first start")
        except OSError as error:
            return fail("database", f"{path} cannot be created: {error.strerror}", f"Make {folder} writable.")
    try:
        connection = sqlite3.connect(
            f"file:{quote(str(path))}?mode=rw", uri=True, timeout=timeout_s / 2, isolation_level=None
        )
        try:
            connection.execute("BEGIN IMMEDIATE")
            tables = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'alembic_version'").fetchone()
            version = connection.execute("SELECT version_num FROM alembic_version").fetchone()[0] if tables else None
            connection.execute("ROLLBACK")
        finally:
            connection.close()
    except sqlite3.Error as error:
        return fail(
            "database",
            f"{path}: {error}",
            "Check that it is a database of Meshdeform, and that its disk is writable and not full.",
        )
    return _schema_finding(f"SQLite {sqlite3.sqlite_version}, {path}", version)


def _database_finding(connection: sa.Connection, url: sa.URL, subject: Subject) -> Finding:
    import sqlalchemy as sa

    where = url.render_as_string(hide_password=True).partition("://")[2]
    detail = f"{connection.dialect.name} at {where}"
    if connection.dialect.name == "postgresql":
        before = time.time()
        now = float(connection.execute(sa.text("SELECT extract(epoch FROM clock_timestamp())")).scalar_one())
        subject.skews_s["PostgreSQL"] = now - (before + time.time()) / 2
        detail = f"PostgreSQL {connection.execute(sa.text('SHOW server_version')).scalar_one().split()[0]} at {where}"
        if connection.execute(sa.text("SHOW transaction_read_only")).scalar_one() == "on":
            return fail("database", f"{detail} is read-only", "Name the primary in MESHDEFORM_DATABASE_URL.")
    version = None
    if sa.inspect(connection).has_table("alembic_version"):
        version = connection.execute(sa.text("SELECT version_num FROM alembic_version")).scalar()
        if connection.dialect.name == "postgresql":
            right = sa.text("SELECT has_table_privilege(current_user, 'jobs', 'INSERT, UPDATE, DELETE')")
            if not connection.execute(right).scalar_one():
                return fail("database", f"{detail}: the user has no write access", "Grant it access to the tables.")
    return _schema_finding(detail, version)


def _schema_finding(detail: str, version: str | None) -> Finding:
    from meshdeform.record.schema import HEAD, compatible

    if version is None:
        return ok("database", f"{detail}, no tables yet: the first start creates them")
    if version == HEAD:
        return ok("database", f"{detail}, schema {version}")
    if compatible(version):
        return ok("database", f"{detail}, schema {version}, of a newer Meshdeform, which this one can use")
    if version < HEAD:
        return warn(
            "database", f"{detail}, schema {version}, not {HEAD}", "The next start migrates it: make a backup first."
        )
    return fail("database", f"{detail}, schema {version}, from a newer Meshdeform", "Install that version.")


def check_store(subject: Subject) -> Iterator[Finding]:
    """Check the object store by writing, reading and deleting a probe."""
    if find_spec("obstore") is None:
        yield skip("object store", _NO_EXTRA)
        return
    location = subject.settings.resolved_storage_url
    folder = (
        None if "://" in location and not location.startswith("file://") else Path(location.removeprefix("file://"))
    )
    from meshdeform.storage import ObjectStore

    # A store that has not been used yet would be created.
    if folder is not None and not (folder.is_dir() and any(folder.iterdir())):
        found = nearest(folder)
        try:
            with tempfile.TemporaryFile(dir=found):
                yield ok("object store", f"{folder} will be created at the first start")
        except OSError as error:
            yield fail("object store", f"{found} cannot be written: {error.strerror}", "Make it writable.")
        return
    where = folder or _where(location)
    key, data = f"doctor-{uuid.uuid4().hex}", b"probe"
    try:
        store = ObjectStore(location, patience_s=subject.timeout_s, create=False)
        try:
            store.put(key, data)
            same = store.get(key) == data
        finally:
            store.delete(key)
        same = same and not store.exists(key)
    except MeshdeformError as error:
        # The default advice of an error is for clients of a service.
        general = folder is None and error.advice_text == error.advice
        yield fail("object store", f"{where}: {error.detail}", _STORE_ADVICE if general else error.advice_text)
        return
    if same:
        yield ok("object store", f"{where} can be written and read")
    else:
        yield fail("object store", f"{where} returns other bytes than were written", "Check its disk.")


def check_workers(subject: Subject) -> Iterator[Finding]:
    """Count the workers that are alive according to the record."""
    url = subject.settings.resolved_database_url
    if find_spec("sqlalchemy") is None or (url.startswith("sqlite") and not _at_head(url)):
        yield skip("workers", "no service has run here yet" if find_spec("sqlalchemy") else _NO_EXTRA)
        return
    if not url.startswith("sqlite") and not _server_at_head(url):
        yield skip("workers", "the record has no tables of this version yet")
        return
    from meshdeform.record.database import Database
    from meshdeform.record.leases import Leases

    database = Database(url)
    try:
        alive = Leases(database).alive(subject.settings.queue)
    finally:
        database.close()
    if alive:
        yield ok("workers", f"{alive} alive on the queue {subject.settings.queue}")
    else:
        yield skip("workers", f"none is alive on the queue {subject.settings.queue}; `meshdeform serve` starts one")


def _at_head(url: str) -> bool:
    import sqlalchemy as sa

    path = Path(sa.make_url(url).database or "")
    return path.exists() and _sqlite(path, 2.0).detail.endswith(f"schema {_head()}")


def _server_at_head(url: str) -> bool:
    import sqlalchemy as sa

    from meshdeform.record.database import make_engine

    engine = make_engine(url)
    try:
        with engine.connect() as connection:
            if not sa.inspect(connection).has_table("alembic_version"):
                return False
            return connection.execute(sa.text("SELECT version_num FROM alembic_version")).scalar() == _head()
    except sa.exc.SQLAlchemyError:
        return False
    finally:
        engine.dispose()


def _head() -> str:
    from meshdeform.record.schema import HEAD

    return HEAD


def _redis_version(text: str) -> str:
    words = [word for word in text.split() if word.startswith("v=")]
    return words[0].removeprefix("v=") if words else text.strip()


def _where(url: str) -> str:
    """Return an address without its secrets."""
    parts = urlsplit(url)
    if parts.scheme == "unix":
        return parts.path
    try:
        port = f":{parts.port}" if parts.port else ""
    except ValueError:
        port = ""
    return f"{parts.scheme}://{parts.hostname or ''}{port}{parts.path}"
