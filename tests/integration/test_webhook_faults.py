"""Webhooks where something goes wrong on the way: a sender that is killed, a receiver that hangs."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import sqlalchemy as sa

from meshdeform.record.models import NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import deliveries
from meshdeform.requests.document import JobRequest
from meshdeform.webhooks.delivery import AT_ONCE, WebhookDelivery
from tests.integration.conftest import DEADLINE_S, WEBHOOK_SETTINGS, new_job, stored_file
from tests.unit.webhooks.receiver import Message, Receiver, receiving

SEND = """
import sys
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.webhooks.delivery import WebhookDelivery
WebhookDelivery(JobRecord(sys.argv[1]), Settings(webhook_networks=["127.0.0.0/8"])).run_once()
"""


def test_a_message_whose_sender_was_killed_comes_again_with_the_same_id(
    record: JobRecord, receiver: Receiver, database_url: str, repository: Path
) -> None:
    webhook, secret = record.webhooks.create("", receiver.url, ["job.queued"])
    new_job(record)
    arrived, over = threading.Event(), threading.Event()

    def answer(message: Message) -> int:
        arrived.set()
        over.wait()
        return 204

    receiver.answer = answer
    with subprocess.Popen([sys.executable, "-c", SEND, database_url], cwd=repository) as child:
        try:
            assert arrived.wait(DEADLINE_S), "the message did not arrive"
        finally:
            child.kill()
            over.set()
    receiver.answer = None
    # It belongs to the dead process for two minutes more.
    sender = WebhookDelivery(record, WEBHOOK_SETTINGS)
    assert sender.run_once() == 0
    with record.database.write() as connection:
        connection.execute(sa.update(deliveries).values(next_at=record.database.now(-1.0)))
    assert sender.run_once() == 1
    first, second = receiver.messages
    assert (first.id, first.body) == (second.id, second.body)
    assert second.is_signed_by(secret)
    (sent,) = record.webhooks.deliveries(webhook.id, "").deliveries
    assert (sent.state, sent.attempts) == ("delivered", 1)


def test_receivers_that_hang_do_not_hold_up_another_ones_messages(record: JobRecord) -> None:
    quick_was_told = threading.Event()

    def hang(message: Message) -> int:
        return 204 if quick_was_told.wait(DEADLINE_S) else 500

    def answer(message: Message) -> int:
        quick_was_told.set()
        return 204

    with receiving() as slow, receiving() as quick:
        slow.answer, quick.answer = hang, answer
        webhook, _ = record.webhooks.create("slow", slow.url, ["job.queued"])
        record.webhooks.create("quick", quick.url, ["job.queued"])
        for owner in ["slow"] * 2 * AT_ONCE + ["quick"]:
            record.create(NewJob(JobRequest(prompt="a mushroom"), {"asset": stored_file()}, owner_id=owner))
        assert WebhookDelivery(record, WEBHOOK_SETTINGS).run_once() == 2 * AT_ONCE + 1
    sent = record.webhooks.deliveries(webhook.id, "slow").deliveries
    assert [(each.state, each.attempts) for each in sent] == [("delivered", 1)] * 2 * AT_ONCE
