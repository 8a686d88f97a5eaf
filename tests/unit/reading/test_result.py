"""A reading that was kept comes back equal; damaged bytes and other versions are refused."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

from meshdeform.nouns.labels import code
from meshdeform.reading import GROUND, NO_PART, VERSION, Reading, result
from meshdeform.reading.version import SOURCES

READING = Reading(
    "dog",
    {"dog": 0.93, "wolf": 0.07},
    np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    0.125,
    np.array([code("head"), code("tail"), GROUND, NO_PART, code("head")]),
    {"head": 0.75, "tail": 1 / 3},
    41,
    0.0125,
    "+Y",
)


@pytest.mark.parametrize("margin", [0.125, None])
def test_a_reading_comes_back_as_it_was(margin: float | None) -> None:
    kept = replace(READING, front_margin=margin)
    back = Reading.from_bytes(kept.to_bytes())
    for field in fields(Reading):
        one, other = getattr(back, field.name), getattr(kept, field.name)
        assert np.array_equal(one, other) if isinstance(other, np.ndarray) else one == other, field.name
    assert back.labels.dtype == np.int64


def test_damaged_bytes_are_refused() -> None:
    data = READING.to_bytes()
    for at in range(len(data)):
        with pytest.raises(ValueError, match="read the asset again"):
            Reading.from_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        with pytest.raises(ValueError, match="read the asset again"):
            Reading.from_bytes(data[:at])


def test_another_version_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    data = READING.to_bytes()
    monkeypatch.setattr(result, "_HEAD", b"meshdeform reading 0123456789abcdef\n")
    with pytest.raises(ValueError, match="version"):
        Reading.from_bytes(data)


def test_the_version_follows_all_that_a_reading_is_made_by() -> None:
    packages = (
        "import sys, meshdeform.vocabulary.grammar, "
        "meshdeform.support.files, meshdeform.support.giving_way, meshdeform.support.sources"
    )
    tell = f"{packages}; old = {{*sys.modules}}; import meshdeform.reading; print(*({{*sys.modules}} - old))"
    told = subprocess.run([sys.executable, "-c", tell], capture_output=True, text=True, check=True).stdout.split()
    loaded = {f"{name.removeprefix('meshdeform.')}." for name in told if name.startswith("meshdeform.")}
    followed = tuple(source.removesuffix(".py").replace("/", ".") + "." for source in SOURCES)
    assert "reading.votes." in loaded
    assert {name for name in loaded if not name.startswith(followed)} == set()
    assert len(VERSION) == 16


def test_what_is_sure() -> None:
    assert READING.sure
    assert not replace(READING, probabilities={"dog": 0.8, "wolf": 0.2}).sure
    assert [replace(READING, front_margin=margin).front_sure for margin in (None, 0.11, 0.05)] == [True, True, False]
    assert READING.front_azimuth_deg == pytest.approx(-90)
    assert replace(READING, up="+Z", turn=np.eye(3)[[0, 2, 1]] * [[1], [1], [-1]]).front_azimuth_deg == pytest.approx(0)


def test_the_names_of_the_parts() -> None:
    assert READING.parts == ("head", "tail")
