"""A job has the words that it names, as they were when it was accepted."""

from __future__ import annotations

from typing import Any

import pytest

from meshdeform.errors import AssetError, ParameterError, VocabularyError
from meshdeform.requests.default_kind import with_kind
from meshdeform.requests.document import JobRequest
from meshdeform.requests.parameters import WORDS_FIELD
from meshdeform.runs import check_request
from meshdeform.runs.text_deform_kind import TEXT_DEFORM
from meshdeform.runs.word_pins import about_own, pinned, pins_of, words_named, words_of
from meshdeform.settings import Settings
from meshdeform.words import in_use, joined
from tests.cases import each_case
from tests.unit.words.words import BOX, WEDGE, box, word


def request(prompt: str = "a tall wedge", **guidance: Any) -> JobRequest:
    asked = JobRequest.model_validate({"prompt": prompt, "params": {"guidance": guidance}})
    return with_kind(asked, "builtin", ["asset"])


def nouns(asked: JobRequest) -> list[str]:
    return [each.noun for each in words_named(asked, [WEDGE, BOX])]


@each_case(
    "asked, named",
    [
        (request("a tall doorstop"), ["wedge"]),
        (request("a dog"), []),
        (request("longer legs", source_noun="dragon box"), ["dragon-box"]),
        (request("", prompts=[{"prompt": "a wedge"}, {"prompt": "a dragon box"}]), ["dragon-box", "wedge"]),
        (request("a wedge", kind="sds"), []),
    ],
)
def test_words_are_named_by_prompts_and_by_what_the_asset_is(asked: JobRequest, named: list[str]) -> None:
    assert nouns(asked) == named


def test_a_request_pins_them_by_their_hashes_and_their_content_goes_with_it() -> None:
    asked, data = pinned(request(), [BOX, WEDGE])
    assert pins_of(asked) == {"wedge": WEDGE.sha256}
    assert data == WEDGE.data
    assert words_of(pins_of(asked), data) == [WEDGE]
    assert JobRequest.model_validate_json(asked.model_dump_json()) == asked
    assert WORDS_FIELD in TEXT_DEFORM.inherits(asked)
    assert pinned(asked, [WEDGE]) == (asked, data)
    plain = request("a dog")
    assert pinned(plain, [BOX, WEDGE]) == (plain, None)
    assert WORDS_FIELD not in TEXT_DEFORM.inherits(plain)


def test_a_pinned_hash_that_nobody_has_is_refused() -> None:
    asked, _ = pinned(request(), [WEDGE])
    with pytest.raises(ParameterError, match="of that hash"):
        pinned(asked, [word("wedge", box())])
    kept, data = pinned(asked, [WEDGE, word("wedge", box())])  # of a branch: what its job has comes first
    assert (kept, data) == (asked, WEDGE.data)


def test_content_that_is_not_what_was_pinned_is_refused() -> None:
    pins = {"wedge": WEDGE.sha256}
    for data in (None, BOX.data, joined([WEDGE, BOX]), word("wedge", box()).data):
        with pytest.raises(ParameterError, match="not what the request pins"):
            words_of(pins, data)
    with pytest.raises(AssetError):
        words_of(pins, WEDGE.data[:-1])


def test_a_job_names_at_most_eight() -> None:
    many = [word("box" + "x" * number, box()) for number in range(9)]
    prompts = [{"prompt": f"a {each.noun}"} for each in many]
    with pytest.raises(ParameterError, match="9 words"):
        pinned(request(prompts[0]["prompt"], prompts=prompts[1:]), many)


def test_a_check_knows_them_and_refuses_what_they_lack() -> None:
    parts = ["asset", WORDS_FIELD]
    with in_use([WEDGE]):
        check_request(pinned(request("a wedge with a big head"), [WEDGE])[0], Settings(), files=parts)
        check_request(pinned(request("taller", source_noun="doorstop"), [WEDGE])[0], Settings(), files=parts)
        with pytest.raises(VocabularyError, match="no ears"):
            check_request(request("a wedge with long ears"), Settings(), files=parts)
        with pytest.raises(VocabularyError, match="'wedge'"):  # no model was trained with it
            check_request(request("a wedge", kind="sds"), Settings(), files=["asset"])
    with pytest.raises(VocabularyError):
        check_request(request(), Settings(), files=["asset"])


def test_a_model_that_lacks_a_word_of_ones_own_says_what_to_do() -> None:
    asked = request("a tall dragon box", kind="sds")
    with pytest.raises(VocabularyError) as refusal:
        check_request(asked, Settings(), files=["asset"])
    assert "guide by shape" in about_own(refusal.value, asked, [BOX]).detail
    assert about_own(refusal.value, asked, [WEDGE]) is refusal.value
