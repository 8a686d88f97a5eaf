"""`meshdeform doctor` on a real PostgreSQL, Redis and S3, well and ill."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from typer.testing import CliRunner

from meshdeform.cli import checks
from meshdeform.cli.app import app
from meshdeform.cli.checks import ok
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import HEAD
from tests.shut_redis import shut_redis


@pytest.fixture(autouse=True)
def _no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "check_gpu", lambda _: iter([ok("gpu", "not asked here")]))


def doctor(*arguments: str) -> tuple[int, dict[str, dict[str, Any]]]:
    """Its exit code, and what it found, by what it looked at."""
    result = CliRunner().invoke(app, ["doctor", "--json", "--timeout", "10", *arguments])
    return result.exit_code, {check["name"]: check for check in json.loads(result.stdout)["checks"]}


def test_servers_that_are_well(
    tmp_path: Path, postgres_url: str, redis_url: str, s3_store_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MESHDEFORM_DATABASE_URL", postgres_url)
    monkeypatch.setenv("MESHDEFORM_REDIS_URL", redis_url)
    monkeypatch.setenv("MESHDEFORM_STORAGE_URL", s3_store_url)
    code, found = doctor("--data-dir", str(tmp_path / "data"))
    assert code == 0, found
    assert found["database"]["status"] == "ok"
    assert "no tables yet" in found["database"]["detail"]
    assert found["redis"]["status"] == found["object store"]["status"] == "ok"
    assert found["workers"]["status"] == "skip"
    # It looked, and made no tables.
    engine = sa.create_engine(postgres_url)
    assert sa.inspect(engine).get_table_names() == []

    record = JobRecord(postgres_url)
    record.leases.idle(WorkerIdentity("a worker", "meshdeform", "cpu"))
    record.close()
    code, found = doctor("--data-dir", str(tmp_path / "data"))
    assert code == 0, found
    assert found["database"]["detail"].endswith(f"schema {HEAD}")
    assert found["database"]["detail"].startswith("PostgreSQL ")
    assert found["workers"]["detail"] == "1 alive on the queue meshdeform"

    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    code, found = doctor("--data-dir", str(tmp_path / "data"))
    assert code == 4
    assert "from a newer Meshdeform" in found["database"]["detail"]
    assert found["database"]["advice"]


def test_a_record_that_takes_no_writes_is_named(postgres_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    JobRecord(postgres_url).close()
    engine = sa.create_engine(postgres_url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        name = sa.make_url(postgres_url).database
        connection.execute(sa.text(f"ALTER DATABASE {name} SET default_transaction_read_only = on"))
    engine.dispose()
    monkeypatch.setenv("MESHDEFORM_DATABASE_URL", postgres_url)
    code, found = doctor()
    assert code == 4
    assert found["database"]["detail"].endswith("is read-only")
    assert "primary" in found["database"]["advice"]


@pytest.mark.parametrize(
    ("wrong", "advice"), [("bucket", "Create the bucket"), ("secret", "Check the AWS_* variables")]
)
def test_a_store_that_refuses_is_named(
    wrong: str, advice: str, s3_store_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if wrong == "bucket":
        s3_store_url = "s3://there-is-none/some/prefix"
    else:
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "not the one")
    monkeypatch.setenv("MESHDEFORM_STORAGE_URL", s3_store_url)
    code, found = doctor()
    assert code == 4
    assert found["object store"]["detail"].startswith(f"{s3_store_url}: ")
    assert found["object store"]["advice"].startswith(advice)


def test_a_redis_that_refuses_is_ill(redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHDEFORM_REDIS_URL", redis_url)
    with shut_redis(redis_url, "full"):
        code, found = doctor("--data-dir", str(tmp_path / "data"))
    assert code != 0
    assert found["redis"]["status"] == "fail"
    assert "maxmemory" in found["redis"]["detail"]
