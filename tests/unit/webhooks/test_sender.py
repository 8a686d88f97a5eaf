"""The sender goes to the address that was checked, and is done in time, whatever DNS and the receiver do."""

from __future__ import annotations

import base64
import hashlib
import hmac
import re
import socket
import ssl
import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from pathlib import Path
from typing import Any

import pytest
import trustme

from meshdeform.outgoing.addresses import parse_networks
from meshdeform.webhooks.sender import Sender, signed_headers
from tests.cases import each_case
from tests.unit.webhooks.receiver import NAME, Message, Receiver, answering, receiving

LOOPBACK = parse_networks(["127.0.0.0/8"], "MESHDEFORM_WEBHOOK_NETWORKS")
SECRET = "whsec_" + base64.b64encode(b"s" * 32).decode()
OTHER = "whsec_" + base64.b64encode(b"o" * 32).decode()
PAYLOAD = {"type": "job.succeeded", "timestamp": "2026-01-31T12:00:00Z", "data": {"prompt": "Pilz \u2013 茸"}}
HEAD = b"HTTP/1.1 200 OK\r\n"


def send(sender: Sender, url: str, *secrets: str) -> Any:
    return sender.send(url, "msg_1", PAYLOAD, secrets or (SECRET,))


def test_what_arrives_is_verified_by_the_specifications_library() -> None:
    with receiving() as receiver:
        outcome = send(Sender(LOOPBACK), f"{receiver.url}?a=b")
    assert (outcome.delivered, outcome.status, outcome.error) == (True, 204, "")
    (message,) = receiver.messages
    assert message.verified(SECRET) == PAYLOAD
    assert not message.is_signed_by(OTHER)
    assert (message.path, message.id) == ("/hook?a=b", "msg_1")
    assert message.headers["content-type"] == "application/json"
    assert message.headers["host"] == f"127.0.0.1:{receiver.port}"
    assert abs(int(message.headers["webhook-timestamp"]) - outcome.at.timestamp()) <= 1


def test_a_signature_is_the_hmac_that_the_specification_says_and_each_secret_makes_one() -> None:
    headers = signed_headers("msg_1", '{"a":1}', (SECRET, OTHER), datetime.fromtimestamp(1674087231.9, UTC))
    expected = [
        "v1," + base64.b64encode(hmac.digest(key, b'msg_1.1674087231.{"a":1}', hashlib.sha256)).decode()
        for key in (b"s" * 32, b"o" * 32)
    ]
    assert headers["webhook-signature"] == " ".join(expected)
    assert headers["webhook-timestamp"] == "1674087231"


@pytest.fixture(scope="module")
def authority() -> trustme.CA:
    return trustme.CA()


@pytest.fixture
def tls_receiver(authority: trustme.CA) -> Iterator[Receiver]:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert(NAME).configure_cert(context)
    with receiving(context) as receiver:
        yield receiver


def trusting(authority: trustme.CA) -> ssl.SSLContext:
    context = ssl.create_default_context()
    authority.configure_trust(context)
    return context


class Changing:
    """A name server that gives each time the next answer, and the last one for ever."""

    def __init__(self, *answers: list[str]) -> None:
        self.answers, self.asked = list(answers), 0

    def __call__(self, host: str, port: int) -> list[str]:
        self.asked += 1
        return self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]


def test_tls_is_for_the_name_though_the_connection_is_to_the_address(
    authority: trustme.CA, tls_receiver: Receiver
) -> None:
    sender = Sender(LOOPBACK, lookup=Changing(["127.0.0.1"]), tls=trusting(authority))
    outcome = send(sender, f"https://{NAME}:{tls_receiver.port}/hook")
    assert (outcome.status, outcome.error) == (204, "")
    assert tls_receiver.server_names == [NAME]
    assert tls_receiver.messages[0].headers["host"] == f"{NAME}:{tls_receiver.port}"
    # The full stop at the end is no part of a certificate's name.
    assert send(sender, f"https://{NAME}.:{tls_receiver.port}/hook").delivered


def test_a_certificate_of_another_name_or_authority_is_refused(authority: trustme.CA, tls_receiver: Receiver) -> None:
    lookup = Changing(["127.0.0.1"])
    for host, context in (("other.example", trusting(authority)), (NAME, trusting(trustme.CA()))):
        outcome = send(Sender(LOOPBACK, lookup=lookup, tls=context), f"https://{host}:{tls_receiver.port}/hook")
        assert outcome.status is None
        assert outcome.error.startswith("The receiver's certificate is not valid")
    assert tls_receiver.messages == []


def test_a_second_answer_of_the_name_server_changes_nothing(authority: trustme.CA, tls_receiver: Receiver) -> None:
    # Checked once, asked once: the next answer, which would be refused, is not asked for before the next message.
    lookup = Changing(["127.0.0.1"], ["10.0.0.1"])
    sender = Sender(LOOPBACK, lookup=lookup, tls=trusting(authority))
    url = f"https://{NAME}:{tls_receiver.port}/hook"
    assert send(sender, url).delivered
    assert lookup.asked == 1
    assert "not public" in send(sender, url).error
    assert len(tls_receiver.messages) == 1


def test_the_connection_goes_to_the_checked_address_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The resolver says public first and loopback ever after; a sender that asked again would arrive here."""
    connected = []

    def connect(address: tuple[str, int], *_: Any, **__: Any) -> socket.socket:
        connected.append(address)
        raise ConnectionRefusedError

    monkeypatch.setattr(socket, "create_connection", connect)
    answers = Changing(["203.0.114.7", "2a00:1450::7"], ["127.0.0.1"])
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: [(0, 0, 0, "", (a, 0)) for a in answers("", 0)])
    outcome = send(Sender(), "https://rebinding.example/")
    assert outcome.error == "The connection failed."
    assert connected == [("203.0.114.7", 443), ("2a00:1450::7", 443)]
    assert answers.asked == 1


def test_an_address_that_is_down_leaves_the_next_one_its_turn() -> None:
    with receiving() as receiver, socket.socket() as full:
        # Listens and lets nobody in: the queue of this one is full.
        full.bind(("127.0.0.2", receiver.port))
        full.listen(0)
        with socket.create_connection(full.getsockname()):
            sender = Sender(LOOPBACK, lookup=Changing(["127.0.0.2", "127.0.0.1"]), connect_s=1.0)
            assert send(sender, f"http://{NAME}:{receiver.port}/hook").delivered


@each_case(
    ("status", "header", "wait_s"),
    [
        (200, "", 0.0),
        (299, "", 0.0),
        (301, "", 0.0),
        (308, "", 0.0),
        (503, "120", 120.0),
        (503, "in an hour", 3600.0),
        (503, "soon", 0.0),
        (503, "-5", 0.0),
        (503, "Sat, 01 Jan 2000 00:00:00 GMT", 0.0),
    ],
)
def test_every_2xx_counts_and_no_redirect_is_followed(status: int, header: str, wait_s: float) -> None:
    if header == "in an hour":
        header = format_datetime(datetime.now(UTC) + timedelta(hours=1), usegmt=True)
    with receiving() as inside, receiving() as receiver:
        receiver.status, receiver.headers = status, {"Location": inside.url, "Retry-After": header}
        outcome = send(Sender(LOOPBACK), receiver.url)
    assert (outcome.status, outcome.delivered) == (status, status < 300)
    assert outcome.error.startswith("" if status < 300 else f"The receiver answered {status}")
    assert outcome.retry_after_s == pytest.approx(wait_s, abs=100 if wait_s == 3600 else 0)
    assert (len(receiver.messages), inside.messages) == (1, [])


def test_proxies_of_the_environment_are_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    with receiving() as proxy, receiving() as receiver:
        for name in ("http_proxy", "https_proxy", "all_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY"):
            monkeypatch.setenv(name, f"http://127.0.0.1:{proxy.port}")
        assert send(Sender(LOOPBACK), receiver.url).delivered
    assert (len(receiver.messages), proxy.messages) == (1, [])


def drip(first: bytes, drop: bytes) -> Any:
    def speak(connection: socket.socket, over: threading.Event) -> None:
        connection.recv(65536)
        connection.sendall(first)
        while not over.wait(0.02):
            connection.sendall(drop)

    return speak


@each_case(
    ("first", "drop", "name"),
    [
        (b"", b"", ""),
        (b"", b"H", ""),
        (HEAD, b"X-A: b\r\n", ""),
        (b"", b"HTTP/1.1 100 Continue\r\n\r\n", ""),
        # The beginning of a TLS record of 16 KiB that never comes.
        (b"\x16\x03\x03\x40\x00", b"\x02", NAME),
    ],
)
def test_a_receiver_that_drips_for_ever_is_left_in_time(first: bytes, drop: bytes, name: str) -> None:
    with answering(drip(first, drop)) as port:
        url = f"https://{name}:{port}/" if name else f"http://127.0.0.1:{port}/"
        outcome = send(Sender(LOOPBACK, lookup=Changing(["127.0.0.1"]), total_s=0.5), url)
    assert (outcome.status, outcome.delivered) == (None, False)
    assert outcome.error in ("The receiver did not answer in time.", "The response is not HTTP.")


def test_the_status_counts_though_the_answers_body_never_ends() -> None:
    for first, total_s in ((b"Content-Length: 1000000\r\n\r\n", 0.5), (b"\r\n" + bytes(200_000), 1e5)):
        with answering(drip(HEAD + first, b"x")) as port:
            outcome = send(Sender(LOOPBACK, total_s=total_s), f"http://127.0.0.1:{port}/")
        assert (outcome.status, outcome.delivered) == (200, True)


@each_case("nonsense", [b"SSH-2.0-OpenSSH_9.6\r\n", b"\x00\x01\x02\r\n\r\n", b"", HEAD + b"A" * 300_000])
def test_what_is_no_http_is_a_failure(nonsense: bytes) -> None:
    def speak(connection: socket.socket, over: threading.Event) -> None:
        connection.recv(65536)
        connection.sendall(nonsense)

    with answering(speak) as port:
        outcome = send(Sender(LOOPBACK), f"http://127.0.0.1:{port}/")
    assert (outcome.status, outcome.delivered) == (None, False)
    assert outcome.error in ("The response is not HTTP.", "The connection failed.")


def test_nothing_of_an_answer_is_in_what_is_told() -> None:
    secret = b"HTTP/1.1 500 root:x:0:0\r\nX-Secret: root:x:0:0\r\n\r\n"
    with answering(drip(secret, b"root:x:0:0")) as port:
        outcome = send(Sender(LOOPBACK, total_s=0.5), f"http://127.0.0.1:{port}/")
    assert outcome.status == 500
    assert "root" not in repr(outcome)


@pytest.mark.parametrize("secure", [False, True])
def test_a_closed_sender_cuts_what_is_under_way_and_begins_nothing(authority: trustme.CA, secure: bool) -> None:
    waiting, over = threading.Event(), threading.Event()

    def answer(message: Message) -> int:
        waiting.set()
        over.wait()
        return 204

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert(NAME).configure_cert(context)
    sender = Sender(LOOPBACK, lookup=Changing(["127.0.0.1"]), tls=trusting(authority), total_s=300.0)
    outcomes: list[Any] = []
    with receiving(context if secure else None) as receiver:
        receiver.answer = answer
        url = f"https://{NAME}:{receiver.port}/hook" if secure else receiver.url
        thread = threading.Thread(target=lambda: outcomes.append(send(sender, url)))
        thread.start()
        assert waiting.wait(30)
        sender.close()
        thread.join(30)
        over.set()
        assert [(outcome.status, outcome.delivered) for outcome in outcomes] == [(None, False)]
        assert send(sender, url).error == "The connection failed."
    assert sender._open == set()


# What docs/webhooks.md shows receivers works on what the sender sends.


BODY = '{"type":"job.succeeded"}'


@pytest.fixture(scope="module")
def shown(repository: Path) -> dict[str, Any]:
    """What the page's Python defines."""
    names: dict[str, Any] = {}
    page = (repository / "docs/webhooks.md").read_text()
    for block in re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE):
        exec(compile(block, "docs/webhooks.md", "exec"), names)
    return names


def headers(*secrets: str, ago_s: float = 0.0) -> dict[str, str]:
    return signed_headers("msg_1", BODY, secrets, datetime.now(UTC) - timedelta(seconds=ago_s))


def test_both_ways_to_verify_take_what_is_sent_and_nothing_else(shown: dict[str, Any]) -> None:
    def verdicts(body: str, sent: dict[str, str]) -> list[bool]:
        return [
            shown["receive"](body.encode(), sent, SECRET) is not None,
            shown["is_genuine"](body.encode(), sent, SECRET),
        ]

    assert verdicts(BODY, headers(SECRET)) == verdicts(BODY, headers(OTHER, SECRET)) == [True, True]
    assert verdicts(BODY + " ", headers(SECRET)) == [False, False]
    assert verdicts(BODY, headers(OTHER)) == [False, False]
    assert verdicts(BODY, headers(SECRET, ago_s=400)) == [False, False]
    assert verdicts(BODY, {**headers(SECRET), "webhook-id": "msg_2"}) == [False, False]
