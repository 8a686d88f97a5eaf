"""``python -m worker``: the supervisor, which starts and monitors the worker process."""

from __future__ import annotations

import sys

from meshdeform.errors import MeshdeformError, RecordVersionError
from meshdeform.serving.processes import FOREIGN_RECORD
from meshdeform.settings import Settings
from meshdeform.support.telemetry import configure_logging
from meshdeform.support.threads import limit_waiting
from worker.supervisor import PROCESS_MODULE, Supervisor


def main(process_module: str = PROCESS_MODULE) -> None:
    """Run until SIGINT or SIGTERM."""
    limit_waiting()  # inherited by the worker process, which imports torch
    settings = Settings()
    configure_logging(settings)
    try:
        Supervisor(settings, process_module).run()
    except RecordVersionError as error:
        print(error.detail, error.advice_text, file=sys.stderr)
        sys.exit(FOREIGN_RECORD)
    except MeshdeformError as error:
        sys.exit(f"{error.detail} {error.advice_text}")


if __name__ == "__main__":
    main()
