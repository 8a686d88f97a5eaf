"""Our own signed URLs: nothing of them can be changed."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshdeform.errors import ForbiddenError
from meshdeform.storage import sign_path, verify_path
from tests.cases import each_case

SECRET = b"0123456789abcdef"
PATH = "/v1/jobs/a/artifacts/result.glb"
NOW = 1_800_000_000
QUERY = sign_path("GET", PATH, NOW + 60, SECRET, {"filename": "a mushroom & more.glb", "b": ""})


def test_a_signed_url_is_let_through_with_its_parameters() -> None:
    for now in (NOW, NOW + 59.9):
        assert verify_path("GET", PATH, QUERY, SECRET, now) == {"filename": "a mushroom & more.glb", "b": ""}
    assert sign_path("GET", "/a", 1, SECRET) == (
        "expires=1&signature=17e677342f11ef1f08a2af4cea68cd97ec9d68ee8550b329a8d44a260756b93a"
    )
    verify_path("GET", PATH, sign_path("GET", PATH, int(time.time()) + 600, SECRET), SECRET)
    with pytest.raises(ForbiddenError, match="expired"):
        verify_path("GET", PATH, sign_path("GET", PATH, int(time.time()) - 1, SECRET), SECRET)
    with pytest.raises(ValueError, match="16 bytes"):
        sign_path("GET", PATH, NOW, b"short")
    with pytest.raises(ValueError, match="must not be named"):
        sign_path("GET", PATH, NOW, SECRET, {"expires": "1"})


@each_case(
    ("method", "path", "secret", "now"),
    [
        ("PUT", PATH, SECRET, NOW),
        ("HEAD", PATH, SECRET, NOW),
        ("GET", PATH + "/", SECRET, NOW),
        ("GET", PATH.replace("/a/", "/b/"), SECRET, NOW),
        ("GET", PATH + "\nexpires=1", SECRET, NOW),
        ("GET", PATH, b"another secret 16", NOW),
        ("GET", PATH, SECRET, NOW + 60),
    ],
)
def test_another_method_path_secret_or_time_is_refused(method: str, path: str, secret: bytes, now: float) -> None:
    with pytest.raises(ForbiddenError):
        verify_path(method, path, QUERY, secret, now)


@each_case(
    "query",
    [
        "",
        "expires=1",
        QUERY.partition("&signature=")[0],
        QUERY.replace(f"expires={NOW + 60}", f"expires={NOW + 61}"),
        QUERY.replace(f"expires={NOW + 60}", "expires=never"),
        QUERY.replace(f"expires={NOW + 60}&", ""),
        QUERY.replace("mushroom", "toadstool"),
        QUERY.replace("b=&", ""),
        QUERY + "&more=1",
        QUERY + "&" + QUERY,
        QUERY + "&signature=" + "0" * 64,
        QUERY + f"&expires={NOW + 60}",
        QUERY.rpartition("=")[0] + "=" + QUERY.rpartition("=")[2].upper(),
        QUERY.rpartition("=")[0] + "=%C3%A4",
        QUERY.rpartition("=")[0] + "=%FF",
        "&".join(f"{number}=" for number in range(1000)),
        "\x00=\x00",
    ],
)
def test_a_query_that_was_touched_is_refused(query: str) -> None:
    with pytest.raises(ForbiddenError):
        verify_path("GET", PATH, query, SECRET, NOW)


@given(st.integers(0, len(QUERY) - 1), st.characters(codec="utf-8"))
def test_no_single_character_can_be_changed(index: int, letter: str) -> None:
    touched = QUERY[:index] + letter + QUERY[index + 1 :]
    # A space has three spellings, with one meaning.
    if touched.replace("%20", "+").replace(" ", "+") == QUERY:
        return
    with pytest.raises(ForbiddenError):
        verify_path("GET", PATH, touched, SECRET, NOW)


@given(st.text(), st.dictionaries(st.text(min_size=1), st.text(), max_size=5))
def test_every_path_and_parameter_survives(path: str, parameters: dict[str, str]) -> None:
    parameters = {name: value for name, value in parameters.items() if name not in ("expires", "signature")}
    try:
        query = sign_path("PUT", path, NOW + 1, SECRET, parameters)
    except UnicodeEncodeError:
        return  # a lone surrogate is in no URL
    assert verify_path("PUT", path, query, SECRET, NOW) == parameters
