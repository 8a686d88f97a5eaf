"""The servers that the other tests lean on are the real ones."""

from __future__ import annotations

import redis
import sqlalchemy as sa


def test_redis_answers_and_is_empty(redis_url: str) -> None:
    with redis.Redis.from_url(redis_url) as connection:
        assert connection.ping()
        assert connection.dbsize() == 0
        assert connection.info("server")["redis_version"].split(".")[0].isdigit()


def test_postgres_gives_each_test_a_database_of_its_own(postgres_url: str) -> None:
    engine = sa.create_engine(postgres_url)
    with engine.begin() as connection:
        assert "PostgreSQL" in connection.execute(sa.text("SELECT version()")).scalar_one()
        assert sa.inspect(connection).get_table_names() == []
    engine.dispose()
