"""``python -m service``: one API process on a socket that its parent listens on.

`meshdeform api` becomes this program, so that the command line does not stay in memory; `meshdeform serve` starts it.
"""

from __future__ import annotations

import argparse
import logging
import signal
import socket
import sys
from collections.abc import Sequence

from meshdeform.errors import RecordVersionError
from meshdeform.serving.processes import FOREIGN_RECORD
from meshdeform.settings import Settings
from meshdeform.support.memory import collection_paused, limit_heaps
from meshdeform.support.telemetry import ACCESS_LOG, configure_logging

_GRACE_S = 10


def main(arguments: Sequence[str] | None = None) -> None:
    """Run until SIGINT or SIGTERM. Everything but the socket is read from the environment."""
    parser = argparse.ArgumentParser(prog="python -m service", description=main.__doc__)
    parser.add_argument("--fd", type=int, required=True, help="descriptor of the listening socket")
    parser.add_argument("--access-log", action=argparse.BooleanOptionalAction, help="default: if the log is JSON")
    options = parser.parse_args(arguments)
    limit_heaps()
    import uvicorn

    from meshdeform.record.database import check_version
    from meshdeform.serving.connections import http_options, raise_open_files

    settings = Settings()  # the parent has checked them
    configure_logging(settings)
    try:
        check_version(settings.resolved_database_url)
    except RecordVersionError as error:
        print(error.detail, error.advice_text, file=sys.stderr)
        sys.exit(FOREIGN_RECORD)
    logged = settings.log_format == "json" if options.access_log is None else options.access_log
    if not logged:
        logging.getLogger(ACCESS_LOG).setLevel(logging.WARNING)
    raise_open_files()
    config = uvicorn.Config(
        "service.app:create_app",
        factory=True,
        log_config=None,
        timeout_graceful_shutdown=_GRACE_S,
        **http_options(settings),
    )
    with collection_paused(keep=True):
        config.load()
    # uvicorn raises the signal that stopped it again at the end; a clean stop must give exit code 0.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    uvicorn.Server(config).run(sockets=[socket.socket(fileno=options.fd)])


if __name__ == "__main__":
    main()
