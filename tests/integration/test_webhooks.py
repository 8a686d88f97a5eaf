"""Messages to webhooks from the event to the receiver, with real sockets."""

from __future__ import annotations

import threading
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
import sqlalchemy as sa

from meshdeform.errors import ConflictError
from meshdeform.record.deliveries import RETRY_AFTER_S
from meshdeform.record.models import NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import deliveries, delivery_attempts, webhooks
from meshdeform.record.webhooks import Webhook
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings
from meshdeform.webhooks.delivery import AT_ONCE, WebhookDelivery
from tests.integration.conftest import DEADLINE_S, WEBHOOK_SETTINGS, new_job, stored_file
from tests.unit.webhooks.receiver import Message, Receiver, receiving
from tests.waiting import until


def make_due(record: JobRecord) -> None:
    """Let the time pass until the next attempts."""
    with record.database.write() as connection:
        pending = deliveries.c.state == "pending"
        connection.execute(sa.update(deliveries).where(pending).values(next_at=record.database.now(-1.0)))


def only_delivery(record: JobRecord, webhook: Webhook, owner: str = "") -> Any:
    (found,) = record.webhooks.deliveries(webhook.id, owner).deliveries
    return record.webhooks.delivery(webhook.id, found.id, owner)


def sums(record: JobRecord) -> dict[str, float]:
    return {label: value for (name, label), value in record.counters().items() if name == "webhook_deliveries"}


def test_every_event_of_a_job_arrives_signed(record: JobRecord, delivery: WebhookDelivery, receiver: Receiver) -> None:
    webhook, secret = record.webhooks.create("", receiver.url)
    job = new_job(record)
    record.request_cancel(job.id)
    assert delivery.run_once() == 2
    told = {message.id: message.verified(secret) for message in receiver.messages}
    assert sorted((event["data"]["seq"], event["type"]) for event in told.values()) == [
        (1, "job.queued"),
        (2, "job.canceled"),
    ]
    for event in told.values():
        assert event["data"]["job"]["id"] == job.id
        assert datetime.fromisoformat(event["timestamp"]).tzinfo is not None
    page = record.webhooks.deliveries(webhook.id, "")
    assert {found.id for found in page.deliveries} == set(told)
    assert {(found.state, found.attempt_count, found.next_at) for found in page.deliveries} == {("delivered", 1, None)}
    (attempt,) = record.webhooks.delivery(webhook.id, page.deliveries[0].id, "").attempts
    assert (attempt.number, attempt.status, attempt.error) == (1, 204, None)
    assert delivery.run_once() == 0
    assert sums(record) == {"delivered": 2}


def test_a_webhook_hears_only_of_what_it_asked_for(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    _, secret = record.webhooks.create("", receiver.url, ["job.canceled", "job.canceled", "job.failed"])
    record.request_cancel(new_job(record).id)
    delivery.run_once()
    assert [message.verified(secret)["type"] for message in receiver.messages] == ["job.canceled"]


@pytest.mark.both_databases
def test_it_is_tried_by_the_schedule_and_then_given_up(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    webhook, _ = record.webhooks.create("", receiver.url, ["job.queued"])
    new_job(record)
    receiver.status = 500
    for number, delay in enumerate(RETRY_AFTER_S, start=1):
        before = datetime.now(UTC)
        assert delivery.run_once() == 1
        found = only_delivery(record, webhook)
        assert (found.state, found.attempt_count) == ("pending", number)
        # Up to a tenth later, so that not all come back at the same instant.
        asked = (before + timedelta(seconds=delay - 5), datetime.now(UTC) + timedelta(seconds=1.1 * delay + 5))
        assert asked[0] < found.next_at < asked[1]
        assert delivery.run_once() == 0
        make_due(record)
    assert delivery.run_once() == 1
    found = only_delivery(record, webhook)
    assert (found.state, found.attempt_count, found.next_at) == ("failed", 10, None)
    assert [(attempt.number, attempt.status) for attempt in found.attempts] == [
        (number, 500) for number in range(1, 11)
    ]
    assert {attempt.error for attempt in found.attempts} == {"The receiver answered 500."}
    assert len({message.id for message in receiver.messages}) == 1
    assert sum(RETRY_AFTER_S) == 75 * 3600 + 35 * 60 + 5
    assert sums(record) == {"retried": 9, "failed": 1}


def test_a_receiver_may_ask_for_more_time_but_not_for_less(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    webhook, _ = record.webhooks.create("", receiver.url, ["job.queued"])
    new_job(record)
    for asked, least, most in ((3600, 3500, 4000), (1, 290, 340), (10**8, 86_000, 96_000)):
        receiver.status, receiver.headers = 429, {"Retry-After": str(asked)}
        assert delivery.run_once() == 1
        wait_s = (only_delivery(record, webhook).next_at - datetime.now(UTC)).total_seconds()
        assert least < wait_s < most
        make_due(record)


def test_the_address_is_checked_again_when_a_message_is_sent(record: JobRecord, receiver: Receiver) -> None:
    # It was allowed when it was entered; the operator has taken the network away since.
    webhook, _ = record.webhooks.create("", receiver.url, ["job.queued"])
    new_job(record)
    assert WebhookDelivery(record, Settings()).run_once() == 1
    (attempt,) = only_delivery(record, webhook).attempts
    assert (attempt.status, "not public" in attempt.error) == (None, True)
    assert receiver.messages == []


def test_two_signatures_while_the_secret_is_changed(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    webhook, first = record.webhooks.create("", receiver.url, ["job.queued"])
    changed, second = record.webhooks.rotate(webhook.id, "")
    assert changed.rotation_ends_at is not None
    assert timedelta(hours=23) < changed.rotation_ends_at - datetime.now(UTC) <= timedelta(hours=24)
    assert len({first, second}) == 2
    assert first.startswith("whsec_")

    def signers() -> list[bool]:
        new_job(record)
        assert delivery.run_once() == 1
        return [receiver.messages[-1].is_signed_by(secret) for secret in secrets]

    secrets = [first, second]
    assert signers() == [True, True]
    assert len(receiver.messages[-1].headers["webhook-signature"].split(" ")) == 2
    with record.database.write() as connection:
        connection.execute(sa.update(webhooks).values(previous_until=record.database.now(-1.0)))
    assert signers() == [False, True]
    # Of three secrets the two newest sign: a stolen one is out after two changes.
    secrets += [record.webhooks.rotate(webhook.id, "")[1], record.webhooks.rotate(webhook.id, "")[1]]
    assert signers() == [False, False, True, True]


def test_gone_disables_the_webhook_until_it_is_enabled(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    webhook, _ = record.webhooks.create("", receiver.url, ["job.queued"])
    for _ in range(3):
        new_job(record)
    receiver.status = 500
    assert delivery.run_once() == 3
    with record.database.write() as connection:
        first = sa.select(sa.func.min(deliveries.c.id)).scalar_subquery()
        due = sa.update(deliveries).where(deliveries.c.id == first).values(next_at=record.database.now(-1.0))
        connection.execute(due)
    receiver.status = 410
    assert delivery.run_once() == 1
    found = record.webhooks.get(webhook.id, "")
    assert found.disabled_at is not None
    assert found.disabled_reason == "the receiver answered 410 Gone"
    log = record.webhooks.deliveries(webhook.id, "").deliveries
    assert [(each.state, each.next_at) for each in log] == [("failed", None)] * 3
    assert sums(record) == {"retried": 3, "failed": 3}
    new_job(record)
    assert delivery.run_once() == 0
    for refused in (lambda: record.webhooks.replay(webhook.id, log[0].id, ""),
                    lambda: record.webhooks.send_test(webhook.id, "")):  # fmt: skip
        with pytest.raises(ConflictError, match="disabled"):
            refused()
    enabled = record.webhooks.update(webhook.id, "", enabled=True)
    assert (enabled.disabled_at, enabled.disabled_reason) == (None, None)
    receiver.status = 204
    new_job(record)
    assert delivery.run_once() == 1


@pytest.mark.both_databases
def test_many_answers_of_gone_at_once(record: JobRecord, delivery: WebhookDelivery, receiver: Receiver) -> None:
    for _ in range(2):
        record.webhooks.create("", receiver.url)
    for _ in range(6):
        new_job(record)
    receiver.status = 410
    assert delivery.run_once() >= 2
    for webhook in record.webhooks.list_webhooks(""):
        assert webhook.disabled_at is not None
        states = [found.state for found in record.webhooks.deliveries(webhook.id, "").deliveries]
        assert states == ["failed"] * 6
    assert sums(record) == {"failed": 12}


def test_what_was_pending_when_its_owner_disabled_it_fails(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    webhook, _ = record.webhooks.create("", receiver.url, ["job.queued"])
    new_job(record)
    assert record.webhooks.update(webhook.id, "", enabled=False).disabled_reason == "disabled by its owner"
    found = only_delivery(record, webhook)
    assert (found.state, found.next_at) == ("failed", None)
    # One that was written by a transaction that did not see the change yet.
    with record.database.write() as connection:
        connection.execute(sa.update(deliveries).values(state="pending", next_at=record.database.now()))
    assert delivery.run_once() == 0
    assert only_delivery(record, webhook).state == "failed"
    assert receiver.messages == []


def test_a_replay_is_a_new_delivery_of_the_same_message(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    webhook, secret = record.webhooks.create("", receiver.url, ["job.queued"])
    job = new_job(record)
    first = only_delivery(record, webhook)
    with pytest.raises(ConflictError, match="pending"):
        record.webhooks.replay(webhook.id, first.id, "")
    delivery.run_once()
    again = record.webhooks.replay(webhook.id, first.id, "")
    assert (again.replay_of, again.state, again.attempt_count, again.job_id) == (first.id, "pending", 0, job.id)
    assert delivery.run_once() == 1
    third = record.webhooks.replay(webhook.id, again.id, "")
    assert third.replay_of == first.id
    assert delivery.run_once() == 1
    assert [message.id for message in receiver.messages] == [first.id] * 3
    assert len({message.body for message in receiver.messages}) == 1
    assert all(message.is_signed_by(secret) for message in receiver.messages)
    assert record.webhooks.delivery(webhook.id, first.id, "").state == "delivered"


@pytest.mark.both_databases
def test_senders_side_by_side_send_each_message_once(record: JobRecord, receiver: Receiver) -> None:
    webhook, _ = record.webhooks.create("", receiver.url)
    for _ in range(40):
        new_job(record)
    senders = [WebhookDelivery(record, WEBHOOK_SETTINGS) for _ in range(3)]
    start = threading.Barrier(len(senders))
    counts: list[int] = []

    def run(sender: WebhookDelivery) -> None:
        start.wait()
        counts.append(sender.run_once())

    threads = [threading.Thread(target=run, args=(sender,)) for sender in senders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sum(counts) == 40
    assert sorted(message.id for message in receiver.messages) == sorted(
        found.id for found in record.webhooks.deliveries(webhook.id, "", limit=100).deliveries
    )
    assert sums(record) == {"delivered": 40}


@pytest.mark.both_databases
def test_what_one_has_taken_another_does_not_get_until_the_takers_time_is_over(
    record: JobRecord, receiver: Receiver
) -> None:
    webhook, _ = record.webhooks.create("", receiver.url, ["job.queued"])
    new_job(record)
    (taken,) = record.deliveries.due(8)
    assert record.deliveries.due(8) == []
    make_due(record)  # its taker has died, perhaps after it sent the message
    (again,) = record.deliveries.due(8)
    assert (again.id, again.message_id) == (taken.id, taken.message_id)
    now = datetime.now(UTC)
    record.deliveries.failed(again, at=now, status=503, error="busy", seconds=0.1)
    # The first one was only slow, and comes too late.
    record.deliveries.succeeded(taken, at=now, status=200, seconds=0.1)
    record.deliveries.failed(taken, at=now, status=410, error="gone", seconds=0.1)
    found = only_delivery(record, webhook)
    assert (found.state, found.attempt_count, len(found.attempts)) == ("pending", 1, 1)
    assert record.webhooks.get(webhook.id, "").disabled_at is None
    assert sums(record) == {"retried": 1}


def test_a_webhook_that_is_deleted_is_sent_nothing_more(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    webhook, _ = record.webhooks.create("", receiver.url)
    new_job(record)
    (taken,) = record.deliveries.due(1)
    record.webhooks.delete(webhook.id, "")
    record.deliveries.succeeded(taken, at=datetime.now(UTC), status=200, seconds=0.1)
    new_job(record)
    make_due(record)
    assert delivery.run_once() == 0
    assert receiver.messages == []
    assert record.webhooks.list_webhooks("") == []
    with record.database.read() as connection:
        for table in (deliveries, delivery_attempts):
            assert connection.execute(sa.select(sa.func.count()).select_from(table)).scalar_one() == 0
    assert sums(record) == {}


def test_it_runs_beside_the_api_sends_what_comes_and_stops_at_once(record: JobRecord, receiver: Receiver) -> None:
    waiting, over = threading.Event(), threading.Event()

    def answer(message: Message) -> int:
        waiting.set()
        over.wait()
        return 204

    webhook, _ = record.webhooks.create("", receiver.url, ["job.queued"])
    with WebhookDelivery(record, WEBHOOK_SETTINGS):
        new_job(record)
        until(lambda: only_delivery(record, webhook).state == "delivered")
        receiver.answer = answer
        new_job(record)
        assert waiting.wait(DEADLINE_S)
    # The one that was under way is nobody's fault, and due again.
    over.set()
    newest = record.webhooks.deliveries(webhook.id, "").deliveries[0]
    assert (newest.state, newest.attempt_count) == ("pending", 0)
    receiver.answer = None
    assert WebhookDelivery(record, WEBHOOK_SETTINGS).run_once() == 1


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
    assert [(each.state, each.attempt_count) for each in sent] == [("delivered", 1)] * 2 * AT_ONCE
