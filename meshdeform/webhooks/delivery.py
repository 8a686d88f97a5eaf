"""Send due messages to webhooks from threads of the API process: several at once, in no particular order.

Every API process may run one. A message arrives at least once: if a process dies between sending it and recording
that, another one sends it again with the same `webhook-id`.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import TYPE_CHECKING, Self

from meshdeform.errors import MeshdeformError
from meshdeform.outgoing.addresses import parse_networks
from meshdeform.outgoing.lookups import LookupPool
from meshdeform.record.deliveries import DueDelivery
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings

if TYPE_CHECKING:
    from meshdeform.webhooks.sender import Sender

AT_ONCE = 16
"""Number of messages that one process sends at a time."""

_EACH = 4
"""Number of these to one webhook, and to all webhooks of one owner, so that slow ones do not block the others."""
_LOOKUPS_AT_ONCE = 32  # more than AT_ONCE: one that has exceeded its deadline still occupies a thread
_LOOK_EVERY_S = 1.0
_CLEAN_EVERY_S = 600.0
_log = logging.getLogger(__name__)


class WebhookDelivery:
    """The sender of webhooks; as a context manager it runs in its own threads.

    `DependencyError`: the setting `webhook_networks` is not a list of networks.
    """

    def __init__(self, record: JobRecord, settings: Settings) -> None:
        self._deliveries = record.deliveries
        self._sender: Sender | None = None
        self._networks = parse_networks(settings.webhook_networks, "MESHDEFORM_WEBHOOK_NETWORKS")
        self._done = threading.Event()
        self._clean_at = 0.0
        self._thread = threading.Thread(target=self._run, name="webhooks", daemon=True)

    def run_once(self) -> int:
        """Send all due messages, including those that become due meanwhile, and return the number of attempts.

        If the record does not answer (`UnavailableError`), the messages taken become due again when this process's
        claim expires.
        """
        if time.monotonic() >= self._clean_at:
            self._clean_at = time.monotonic() + _CLEAN_EVERY_S
            while self._deliveries.delete_old_deliveries() and not self._done.is_set():
                pass
        first = self._deliveries.due(AT_ONCE, each=_EACH, each_owner=_EACH)
        return self._send_all(first) if first else 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        if self._sender is not None:
            self._sender.close()
        self._thread.join()

    def _send_all(self, due: list[DueDelivery]) -> int:
        sender, count = self._open_sender(), 0
        if self._done.is_set():
            sender.close()
        under_way: dict[Future[None], DueDelivery] = {}
        with ThreadPoolExecutor(AT_ONCE, thread_name_prefix="webhook") as pool:
            while due or under_way:
                for delivery in due:
                    under_way[pool.submit(self._send, sender, delivery)] = delivery
                count += len(due)
                # A slow message must not keep idle threads from those that become due meanwhile.
                for future in wait(under_way, timeout=_LOOK_EVERY_S, return_when=FIRST_COMPLETED).done:
                    del under_way[future]
                    future.result()
                due = [] if self._done.is_set() else self._more(list(under_way.values()))
        return count

    def _more(self, under_way: list[DueDelivery]) -> list[DueDelivery]:
        if len(under_way) >= AT_ONCE:
            return []
        return self._deliveries.due(
            AT_ONCE - len(under_way),
            without=_busy(delivery.webhook_id for delivery in under_way),
            without_owners=_busy(delivery.owner_id for delivery in under_way),
            each=_EACH // 2,
            each_owner=_EACH // 2,
        )

    def _send(self, sender: Sender, due: DueDelivery) -> None:
        outcome = sender.send(due.url, due.message_id, due.payload, due.secrets)
        if sender.closed and not outcome.delivered:
            # Interrupted by our own shutdown, not by the receiver.
            return self._deliveries.give_back(due)
        if outcome.delivered and outcome.status is not None:
            return self._deliveries.succeeded(due, at=outcome.at, status=outcome.status, seconds=outcome.seconds)
        _log.info("webhook %s, message %s: %s", due.webhook_id, due.message_id, outcome.error)
        return self._deliveries.failed(
            due,
            at=outcome.at,
            status=outcome.status,
            error=outcome.error,
            seconds=outcome.seconds,
            retry_after_s=outcome.retry_after_s,
        )

    def _open_sender(self) -> Sender:
        if self._sender is None:
            # Create the HTTP client only if there are webhooks, to save memory.
            from meshdeform.webhooks.sender import Sender

            self._sender = Sender(self._networks, lookup=LookupPool(_LOOKUPS_AT_ONCE).lookup)
        return self._sender

    def _run(self) -> None:
        while not self._done.is_set():
            try:
                self.run_once()
            except MeshdeformError as error:
                _log.warning("sending webhooks is paused: %s", error)
            except Exception:
                # Without this thread no message is sent, so that it must survive any error.
                _log.exception("unexpected error while sending webhooks")
            self._done.wait(_LOOK_EVERY_S)


def _busy(names: Iterable[str]) -> list[str]:
    """Return the webhooks or owners that have no room for another `_EACH // 2` messages."""
    return [name for name, count in Counter(names).items() if count > _EACH // 2]
