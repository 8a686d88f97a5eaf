"""The record's book of webhooks, on SQLite and on PostgreSQL: owners, limits, pages, and how long the log is kept."""

from __future__ import annotations

import threading

import pytest
import sqlalchemy as sa

from meshdeform.errors import ParameterError, RequestError
from meshdeform.record.models import NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import deliveries
from meshdeform.record.webhooks import MAX_WEBHOOKS
from meshdeform.requests.document import JobRequest
from meshdeform.webhooks.delivery import WebhookDelivery
from tests.integration.conftest import WEBHOOK_SETTINGS, new_job, stored_file
from tests.unit.webhooks.receiver import Receiver

pytestmark = pytest.mark.both_databases


def test_one_webhook_leaves_room_for_the_others(record: JobRecord) -> None:
    slow, _ = record.webhooks.create("slow", "https://slow.example/")
    quick, _ = record.webhooks.create("quick", "https://quick.example/")
    for owner in ["slow"] * 20 + ["quick"]:
        record.create(NewJob(JobRequest(prompt="a mushroom"), {"asset": stored_file()}, owner_id=owner))
    taken = [found.webhook_id for found in record.deliveries.due(8, each=4)]
    assert (taken.count(slow.id), taken.count(quick.id)) == (4, 1)
    assert record.deliveries.due(8, without=[slow.id]) == []
    assert len(record.deliveries.due(3)) == 3


def test_one_owner_leaves_room_for_the_others(record: JobRecord) -> None:
    many = {record.webhooks.create("many", f"https://slow-{number}.example/")[0].id for number in range(10)}
    one, _ = record.webhooks.create("one", "https://quick.example/")
    for owner in ["many"] * 3 + ["one"] * 3:
        record.create(NewJob(JobRequest(prompt="a mushroom"), {"asset": stored_file()}, owner_id=owner))
    first = record.deliveries.due(3, each_owner=2)
    assert sorted(found.owner_id for found in first) == ["many", "many", "one"]
    rest = record.deliveries.due(50, without_owners=["one"])
    assert [found.owner_id for found in rest] == ["many"] * 4
    assert len({found.webhook_id for found in rest}) == 4 <= len(many)
    assert {found.webhook_id for found in record.deliveries.due(50, without_owners=["many"])} == {one.id}


def test_an_owner_has_so_many_and_no_more_also_at_once(record: JobRecord) -> None:
    made: list[str] = []
    refused: list[RequestError] = []

    def make() -> None:
        try:
            made.append(record.webhooks.create("one", "https://example.com/")[0].id)
        except RequestError as error:
            refused.append(error)

    threads = [threading.Thread(target=make) for _ in range(MAX_WEBHOOKS + 5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (len(made), len(refused)) == (MAX_WEBHOOKS, 5)
    assert record.webhooks.create("other", "https://example.com/")
    record.webhooks.delete(made[0], "one")
    assert record.webhooks.create("one", "https://example.com/")


def test_the_log_has_pages(record: JobRecord) -> None:
    webhook, _ = record.webhooks.create("", "https://example.com/", ["job.queued"])
    for _ in range(5):
        new_job(record)
    found, cursor = [], None
    while True:
        page = record.webhooks.deliveries(webhook.id, "", cursor=cursor, limit=2)
        found.append([each.id for each in page.deliveries])
        cursor = page.next_cursor
        if cursor is None:
            break
    assert [len(ids) for ids in found] == [2, 2, 1]
    every = [each for ids in found for each in ids]
    assert every == sorted(set(every), reverse=True)
    assert len(record.webhooks.deliveries(webhook.id, "", state="pending").deliveries) == 5
    assert record.webhooks.deliveries(webhook.id, "", limit=5).next_cursor is None, "a full page may be the last one"
    assert record.webhooks.deliveries(webhook.id, "", state="failed").deliveries == []
    with pytest.raises(ParameterError):
        record.webhooks.deliveries(webhook.id, "", cursor="am9iXzAx")


def test_deliveries_are_forgotten_after_thirty_days(
    record: JobRecord, delivery: WebhookDelivery, receiver: Receiver
) -> None:
    webhook, _ = record.webhooks.create("", receiver.url, ["job.queued"])
    for _ in range(3):
        new_job(record)
    delivery.run_once()
    new_job(record)
    old, young, kept, pending = [each.id for each in reversed(record.webhooks.deliveries(webhook.id, "").deliveries)]
    with record.database.write() as connection:
        for each, days in ((old, 30.1), (young, 29.9), (pending, 31.0)):
            created = record.database.now(-days * 86_400.0)
            connection.execute(sa.update(deliveries).where(deliveries.c.id == each).values(created_at=created))
    # A new process looks at once; one that runs looks every ten minutes.
    assert WebhookDelivery(record, WEBHOOK_SETTINGS).run_once() == 1
    left = [each.id for each in record.webhooks.deliveries(webhook.id, "").deliveries]
    assert sorted(left) == sorted([young, kept, pending])
