"""Pin the words of somebody's own that a request names: their content goes with the job. Torch-free, numpy-free.

A request has the SHA-256 of each word (`params.guidance.words`), and the job a further file, `WORDS_FIELD`, with their
content. What becomes of a word later changes no job that has it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

from meshdeform.errors import ParameterError, VocabularyError
from meshdeform.requests.document import JobRequest
from meshdeform.requests.parameters import MAX_WORDS, WORDS_FIELD, ExemplarParams
from meshdeform.runs.base import ArtifactData, JobRun, StepReport
from meshdeform.vocabulary.grammar import named_nouns
from meshdeform.words import Word, in_use, joined, read_words

__all__ = ["RunWithWords", "about_own", "pinned", "pins_of", "words_named", "words_of"]

R = TypeVar("R", bound=JobRequest)
_PATH = ["params", "guidance", "words"]


def pins_of(request: JobRequest) -> dict[str, str]:
    """Return the SHA-256 of each word that a request pins, by noun; none of a kind of job that has no words."""
    guidance = getattr(request.params, "guidance", None)
    return dict(guidance.words) if isinstance(guidance, ExemplarParams) else {}


def words_named(request: JobRequest, words: Iterable[Word]) -> list[Word]:
    """Return those of an owner's words that a request names: in its prompts, or as what the asset is.

    None if a model guides it, as no model knows them.
    """
    guidance = getattr(request.params, "guidance", None)
    return _named(request, words) if isinstance(guidance, ExemplarParams) else []


def _named(request: JobRequest, words: Iterable[Word]) -> list[Word]:
    guidance = getattr(request.params, "guidance", None)
    own = {word.noun: word for word in words}
    prompts = [each.prompt for each in getattr(guidance, "prompts", ())]
    with in_use(own.values()):
        texts = [request.prompt, *prompts, getattr(guidance, "source_noun", None) or ""]
        nouns = {noun for text in texts for noun in named_nouns(text)}
    return [own[noun] for noun in sorted(nouns & own.keys())]


def about_own(error: VocabularyError, request: JobRequest, words: Iterable[Word]) -> VocabularyError:
    """Return the refusal of a request; where a model guides it and it names words of its owner's, it says what to do.

    `words`: all that the owner has.
    """
    if isinstance(getattr(request.params, "guidance", None), ExemplarParams) or not (named := _named(request, words)):
        return error
    listed = ", ".join(word.noun for word in named)
    detail = f"Your own words guide by shape, and no model knows them: {listed}."
    return VocabularyError(detail, advice="Leave --guidance out, or choose exemplar.", **error.extra)


def pinned(request: R, words: Iterable[Word]) -> tuple[R, bytes | None]:
    """Return a request that pins the words it names, and the content of its field `WORDS_FIELD`, or None without any.

    `words`: all that its owner has; for a branch, those that its job has before those of the same nouns.

    Raises
    ------
    ParameterError
        It names more than `MAX_WORDS`, or pins a word by a hash that none of them has.
    """
    available = list(words)
    pins, chosen = pins_of(request), {word.noun: word for word in words_named(request, available)}
    for noun, sha256 in pins.items():
        word = next((each for each in available if each.noun == noun and each.sha256 == sha256), None)
        if word is None:
            raise ParameterError.at(_PATH, f"You have no word {noun!r} of that hash.", "Leave words out: it is filled.")
        chosen[noun] = word
    if len(chosen) > MAX_WORDS:
        detail = f"The prompts name {len(chosen)} words of your own, and a job has at most {MAX_WORDS}."
        raise ParameterError.at(_PATH, detail, "Name fewer.")
    if not chosen:
        return request, None
    params = request.params
    pins = {noun: word.sha256 for noun, word in sorted(chosen.items())}
    guidance = params.guidance.model_copy(update={"words": pins})
    request = request.model_copy(update={"params": params.model_copy(update={"guidance": guidance})})
    return request, joined(chosen.values())


def words_of(pins: Mapping[str, str], data: bytes | None) -> list[Word]:
    """Return the words of the field `WORDS_FIELD`, which are to be those that a request pins.

    Raises
    ------
    AssetError
        The file is damaged.
    ParameterError
        A word is missing, is another one, or is not pinned.
    """
    words = [] if data is None else read_words(data)
    found = {word.noun: word.sha256 for word in words}
    if found != dict(pins):
        wrong = sorted(noun for noun in {*found, *pins} if found.get(noun) != pins.get(noun))
        detail = f"The content of {', '.join(map(repr, wrong))} is not what the request pins."
        raise ParameterError.at(
            _PATH, detail, f"Send all words that it pins as the field `{WORDS_FIELD}`, and no others."
        )
    return words


class RunWithWords(JobRun):
    """A run that has words of somebody's own at each of its steps, and no other code does in between."""

    def __init__(self, run: JobRun, words: Sequence[Word]) -> None:
        super().__init__(run.total_steps, run.first_step, run.log)
        self.step = run.step
        self._run, self._words = run, words

    def __iter__(self) -> Iterator[StepReport]:
        """Run the remaining steps."""
        steps = iter(self._run)
        while True:
            with in_use(self._words):
                report = next(steps, None)
            if report is None:
                return
            self.step = report.step
            yield report

    @property
    def run(self) -> JobRun:
        """The run itself."""
        return self._run

    def _steps(self) -> Iterator[dict[str, float]]:
        raise NotImplementedError  # its iterator is that of the run

    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""
        with in_use(self._words):
            return self._run.checkpoint()

    def snapshot(self) -> ArtifactData:
        """Return the asset with its current shape; call only between two steps."""
        with in_use(self._words):
            return self._run.snapshot()

    def finish(self) -> dict[str, ArtifactData]:
        """Return the results, by artifact name."""
        with in_use(self._words):
            return self._run.finish()
