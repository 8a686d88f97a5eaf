"""A Redis that answers, and refuses what it is asked for, as an operator, a failover or a full disk may make it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from redis import Redis

from tests.acceptance.service import until

__all__ = ["HALF_SHUT", "WAYS", "shut_redis"]

_Command = tuple[str, ...]
WAYS: dict[str, tuple[list[_Command], list[_Command]]] = {
    "full": ([("CONFIG", "SET", "maxmemory", "1")], [("CONFIG", "SET", "maxmemory", "0")]),
    "a replica of nobody": ([("REPLICAOF", "127.0.0.1", "1")], [("REPLICAOF", "NO", "ONE")]),
    "without its replicas": (
        [("CONFIG", "SET", "min-replicas-to-write", "1")],
        [("CONFIG", "SET", "min-replicas-to-write", "0")],
    ),
    "unable to save": (
        [("CONFIG", "SET", "dir", "/proc"), ("CONFIG", "SET", "save", "3600 1"), ("BGSAVE",)],
        [("CONFIG", "SET", "save", ""), ("CONFIG", "SET", "dir", "/tmp")],
    ),
    "locked": ([("CONFIG", "SET", "requirepass", "secret")], [("CONFIG", "SET", "requirepass", "")]),
    "without permission": ([("ACL", "SETUSER", "default", "-@write")], [("ACL", "SETUSER", "default", "+@all")]),
}
"""What is said to a Redis so that it refuses, and so that it no longer does."""

HALF_SHUT = "without permission to listen"
"""It takes messages, and gives them to nobody."""

_HALF = (
    [("ACL", "SETUSER", "default", "-blmove", "-brpoplpush", "-blpop")],
    [("ACL", "SETUSER", "default", "+@all")],
)


@contextmanager
def shut_redis(url: str, way: str) -> Iterator[Callable[[], None]]:
    """Let a Redis refuse for the block, or until the function that is given is called."""
    shut, opened = {**WAYS, HALF_SHUT: _HALF}[way]
    with Redis.from_url(url) as operator:

        def reopen() -> None:
            for command in opened:
                operator.execute_command(*command)

        try:
            for command in shut:
                operator.execute_command(*command)
            if way == "unable to save":
                until("it could not save", lambda: operator.info()["rdb_last_bgsave_status"] == "err")
            yield reopen
        finally:
            reopen()
