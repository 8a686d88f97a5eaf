"""Sends what is due to webhooks, in a thread beside the API: several messages at once, in no order.

Every API process may run one. A message arrives at least once: a process that dies between sending it and writing so
down lets another one send it again, with the same `webhook-id`.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import TYPE_CHECKING, Self

from meshdeform.errors import MeshdeformError
from meshdeform.record.deliveries import DueDelivery
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.webhooks.addresses import parse_networks

if TYPE_CHECKING:
    from meshdeform.webhooks.sender import Sender

__all__ = ["AT_ONCE", "WebhookDelivery"]

AT_ONCE = 8
"""Messages that one process sends at a time."""

_EACH = 4
"""Of these, how many to one webhook: one that answers slowly leaves room for the others."""
_LOOK_EVERY_S = 1.0
_CLEAN_EVERY_S = 600.0
_log = logging.getLogger(__name__)


class WebhookDelivery:
    """The sender of webhooks; as a context manager it runs in threads of its own.

    Parameters
    ----------
    record : JobRecord
    settings : Settings
        `webhook_networks` counts.
    sender : Sender, optional
        For tests.

    Raises
    ------
    DependencyError
        `webhook_networks` is no list of networks.
    """

    def __init__(self, record: JobRecord, settings: Settings, *, sender: Sender | None = None) -> None:
        self._deliveries, self._sender = record.deliveries, sender
        self._networks = parse_networks(settings.webhook_networks)
        self._done = threading.Event()
        self._clean_at = 0.0
        self._thread = threading.Thread(target=self._run, name="webhooks", daemon=True)

    def run_once(self) -> int:
        """Send everything that is due, and what becomes due meanwhile; return how many attempts that were.

        Raises
        ------
        UnavailableError
            The record does not answer; what was taken is due again when its time with this process is over.
        """
        if time.monotonic() >= self._clean_at:
            self._clean_at = time.monotonic() + _CLEAN_EVERY_S
            while self._deliveries.delete_old_deliveries() and not self._done.is_set():
                pass
        first = self._deliveries.due(AT_ONCE, each=_EACH)
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

    def _send_all(self, taken: list[DueDelivery]) -> int:
        sender, count = self._open_sender(), 0
        if self._done.is_set():
            sender.close()
        under_way: dict[Future[None], DueDelivery] = {}
        with ThreadPoolExecutor(AT_ONCE, thread_name_prefix="webhook") as pool:
            while taken or under_way:
                for delivery in taken:
                    under_way[pool.submit(self._send, sender, delivery)] = delivery
                count += len(taken)
                # A slow one must not keep what becomes due meanwhile from the threads that are free.
                for future in wait(under_way, timeout=_LOOK_EVERY_S, return_when=FIRST_COMPLETED).done:
                    del under_way[future]
                    future.result()
                taken = [] if self._done.is_set() else self._more(list(under_way.values()))
        return count

    def _more(self, under_way: list[DueDelivery]) -> list[DueDelivery]:
        if len(under_way) >= AT_ONCE:
            return []
        counts = Counter(delivery.webhook_id for delivery in under_way)
        busy = [webhook_id for webhook_id, count in counts.items() if count > _EACH // 2]
        return self._deliveries.due(AT_ONCE - len(under_way), without=busy, each=_EACH // 2)

    def _send(self, sender: Sender, due: DueDelivery) -> None:
        outcome = sender.send(due.url, due.message_id, due.payload, due.secrets)
        if sender.closed and not outcome.delivered:
            # Cut by our own end: no fault of the receiver.
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
            # Where nobody has a webhook, the API keeps no HTTP client in memory.
            from meshdeform.webhooks.sender import Sender

            self._sender = Sender(self._networks)
        return self._sender

    def _run(self) -> None:
        while not self._done.is_set():
            try:
                self.run_once()
            except MeshdeformError as error:
                _log.warning("the webhooks wait: %s", error)
            except Exception:
                # Without this thread no message is sent: it must outlive any mistake.
                _log.exception("the sender of webhooks met an error that it does not know")
            self._done.wait(_LOOK_EVERY_S)
