"""Run jobs of kind `text_deform`: deform an asset by a prompt or towards a target mesh.

Joints, morph targets and the nodes that hang on the surface follow it, unless `output.rig` is `keep`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from meshdeform.errors import PartNotFoundError
from meshdeform.plain.words import Sentence
from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.document import ResolvedParams
from meshdeform.requests.parameters import WORDS_FIELD
from meshdeform.runs.base import JobRun, RunInput, RunLog, import_extra, load_model
from meshdeform.runs.believed import believed_source, is_described
from meshdeform.runs.changes import asked_changes, has_controls, is_change
from meshdeform.runs.devices import resolve_device
from meshdeform.runs.facts import AssetFacts
from meshdeform.runs.opened import opened
from meshdeform.runs.plain_change import source_body, start_change
from meshdeform.runs.text_deform_kind import resolved_params
from meshdeform.runs.word_pins import RunWithWords, words_of
from meshdeform.words import in_use

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

_OPTIMISED = "meshdeform.runs.optimised"
"""What needs torch."""


def start(job_input: RunInput) -> JobRun:
    """Read the files and start the run, with the words of somebody's own that the request pins."""
    params = resolved_params(job_input.request, job_input.default_model, job_input.resolved)
    sent = job_input.files.get(WORDS_FIELD)
    words = words_of(params.words, None if sent is None else sent.data)
    with in_use(words):
        run = _started(job_input, params)
    return RunWithWords(run, words) if words else run


def _started(job_input: RunInput, params: ResolvedParams) -> JobRun:
    """Start the run; a prompt that is a change in plain words is carried out at once."""
    log = RunLog()
    request, file, limits = job_input.request, job_input.files["asset"], job_input.limits
    sentence = asked_changes(request.prompt, params)
    # A change needs neither torch nor a prior; whether a description is one, only the asset tells.
    optimised = params.guidance is not GuidanceKind.EXEMPLAR and sentence is None
    prior = _prior(params, job_input) if optimised else None
    file = replace(file, sha256=file.digest)
    with log.phase("read"):
        known = opened(file, params, request.output, limits)
        asset, welded = known.asset, known.welded
    # The optimiser alone has another device.
    facts = AssetFacts(request, params, file, asset, known.division, known.drawn, welded, "cpu")
    if sentence is not None:
        change = _change(facts, sentence, job_input, log)
        if change is not None:
            return change
    if params.guidance is GuidanceKind.EXEMPLAR:
        from meshdeform.runs.exemplar import start_exemplar

        return start_exemplar(facts, job_input, log)
    return _optimised(facts, prior, job_input, log)


def _prior(params: ResolvedParams, job_input: RunInput) -> Prior | None:
    """Return the prior of an optimisation, if a prompt guides it; DependencyError: torch is not installed."""
    import_extra(_OPTIMISED)
    return load_model(params.model, job_input) if params.guidance is GuidanceKind.SDS else None


def _optimised(facts: AssetFacts, prior: Prior | None, job_input: RunInput, log: RunLog) -> JobRun:
    """Start an optimisation; `prior`: None also of a description that turned out to be no change."""
    start: Callable[..., JobRun] = import_extra(_OPTIMISED).start_optimised
    if prior is None:
        prior = _prior(facts.params, job_input)
    return start(replace(facts, device=resolve_device(job_input.device)), prior, job_input, log)


def _change(facts: AssetFacts, sentence: Sentence, job_input: RunInput, log: RunLog) -> JobRun | None:
    """Return the run of a change in plain words, also of a description of what the source is; None if it is none.

    A fit obeys controls, and finds the parts that an asset lacks on the noun's members; no other guidance does.
    """
    if is_change(sentence):
        return start_change(facts, source_body(facts, job_input.readings), sentence, log)
    fitted = facts.params.guidance is GuidanceKind.EXEMPLAR
    goes_on = job_input.initial is not None or job_input.checkpoint is not None
    if goes_on or (fitted and has_controls(facts.params)):
        return None
    with log.phase("parts"):
        body = believed_source(facts, job_input)
        if not is_described(body, sentence.noun):
            return None
    try:
        return start_change(facts, body, sentence, log)
    except PartNotFoundError:
        if fitted:
            return None
        raise
