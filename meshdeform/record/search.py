"""Find jobs by words of their prompts (all that it has), labels and file names."""

from __future__ import annotations

import unicodedata

import sqlalchemy as sa

from meshdeform.record.models import NewJob
from meshdeform.record.schema import job_texts, jobs
from meshdeform.requests.document import DeformParams, JobRequest

__all__ = ["folded", "has_words", "searched_text"]


def folded(text: str) -> str:
    """Return a text in the form in which texts are compared: without differences of case and Unicode composition."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", text).casefold())


def searched_text(new: NewJob) -> str:
    """Return the text in which a search looks for a new job: its prompts, file names and values of labels."""
    names = [file.filename for file in new.files.values()]
    return folded(
        "\n".join([new.request.prompt, *_further_prompts(new.request), *names, *new.request.metadata.values()])
    )


def _further_prompts(request: JobRequest) -> list[str]:
    """Return the prompts beside that of the request; parameters of other kinds of job have none."""
    return [each.prompt for each in request.params.prompts] if isinstance(request.params, DeformParams) else []


def has_words(query: str) -> sa.ColumnElement[bool]:
    """Return the condition that a job's text contains every word of a query, anywhere and in any case.

    Every character of a word stands for itself, `%` and `_` too.
    """
    mine = sa.select(sa.true()).where(job_texts.c.job_id == jobs.c.id)
    for word in folded(query).split():
        mine = mine.where(job_texts.c.text.contains(word, autoescape=True))
    return mine.exists()
