"""``python -m worker``: the supervisor, which starts and tends the worker process."""

from __future__ import annotations

import sys

from meshdeform.errors import MeshdeformError
from meshdeform.settings import Settings
from worker.supervisor import Supervisor, configure_logging


def main() -> None:
    """Run until SIGINT or SIGTERM."""
    configure_logging()
    try:
        Supervisor(Settings()).run()
    except MeshdeformError as error:
        sys.exit(f"{error.detail} {error.advice_text}")


if __name__ == "__main__":
    main()
