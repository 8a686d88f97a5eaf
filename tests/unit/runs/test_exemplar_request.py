"""What `exemplar` guidance takes of a request, and what it refuses, each at its place and with what to do."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from meshdeform.cli.request import make_request
from meshdeform.errors import KindRetiredError, MeshdeformError, ParameterError, PromptError, VocabularyError
from meshdeform.requests.document import GuidanceKind, JobRequest, ResolvedParams, read_stored
from meshdeform.requests.parameters import OF_OPTIMISER, TARGET_FIELDS
from meshdeform.runs import check_request, kind_of
from meshdeform.runs.exemplar_kind import STEPS
from meshdeform.settings import Settings
from tests.cases import each_case

GUIDANCE = ["params", "guidance"]
EXAMPLES: dict[str, Any] = {
    "steps": 300,
    "learning_rate": 0.01,
    "carrier": "lattice",
    "safeguard": "flips",
    "jacobian_reg_weight": 0.1,
    "laplacian_weight": 0.1,
    "normal_weight": 0.1,
    "dirichlet_weight": 0.1,
}


def request(prompt: str = "a giraffe", *, control: dict[str, Any] | None = None, **params: Any) -> JobRequest:
    own = {name: params.pop(name) for name in list(params) if name in {"seed", "preset", *EXAMPLES}}
    guidance = {"kind": "exemplar", **params}
    return JobRequest.model_validate(
        {"prompt": prompt, "params": {**own, "guidance": guidance, "control": control or {}}}
    )


def checked(asked: JobRequest, *files: str, **settings: Any) -> ResolvedParams:
    resolved = check_request(asked, Settings(**settings), files=["asset", *files])
    assert isinstance(resolved, ResolvedParams)
    return resolved


def steps(asked: JobRequest) -> int:
    return kind_of(asked.kind).steps(asked, "builtin", None)


@each_case(
    ("asked", "files"),
    [
        (request(), ()),
        (request("a tall giraffe with long legs", seed=7, preset="preview", strength=0.9), ()),
        (request("", prompts=[{"prompt": "a rabbit"}, {"prompt": "a cat", "weight": 0.5}]), ()),
        (request(orientation=90.0, source_noun="horse"), ()),
        (request(silhouettes=[{"azimuth": 0.0}]), ("silhouette_1",)),
        (request(""), ("target",)),
        (request("", align="none", landmarks=[{"source": 0, "target": 3}]), ("target",)),
        (request(""), TARGET_FIELDS),
        (request(control={"rigid": [{"node": "wheel"}]}), ()),  # no lattice is needed
        (request("longer legs"), ()),
    ],
)
def test_what_can_run_passes(asked: JobRequest, files: tuple[str, ...]) -> None:
    assert checked(asked, *files).guidance is GuidanceKind.EXEMPLAR
    assert checked(asked, *files, model="some/other").guidance is GuidanceKind.EXEMPLAR  # no model is asked


@each_case(
    ("asked", "files", "error", "words", "place"),
    [
        (request(""), (), PromptError, "empty", ["prompt"]),
        (request("a palace"), (), VocabularyError, "no shape for 'palace': 4.. nouns", ["prompt"]),
        (request("an angry dog"), (), VocabularyError, "which 'angry' does not", ["prompt"]),
        (request("a vase with long ears"), (), VocabularyError, "The vase has no ears", ["prompt"]),
        (request("make the legs sing"), (), VocabularyError, "read as a change", ["prompt"]),
        (
            request(prompts=[{"prompt": "a palace"}]),
            (),
            VocabularyError,
            "palace",
            [*GUIDANCE, "prompts", 0, "prompt"],
        ),
        (request(source_noun="zeitgeist"), (), VocabularyError, "no shape for .zeitgeist", [*GUIDANCE, "source_noun"]),
        (request(), ("target",), ParameterError, "there is a prompt", ["prompt"]),
        (request("", prompts=[{"prompt": "a cat"}]), ("target",), ParameterError, "there is a prompt", ["prompt"]),
        (request(align="none"), (), ParameterError, "none was sent", [*GUIDANCE, "align"]),
        (
            request(landmarks=[{"source": 0, "target": 3}]),
            (),
            ParameterError,
            "none was sent",
            [*GUIDANCE, "landmarks"],
        ),
        (
            request("", landmarks=[{"source": 0, "target": 3}]),
            ("target", "target_2"),
            ParameterError,
            "several were sent",
            [*GUIDANCE, "landmarks"],
        ),
        (request(""), ("target_2",), ParameterError, "`target` was not", ["target_2"]),
        (
            request("", silhouettes=[{"azimuth": 0.0}]),
            ("target", "silhouette_1"),
            ParameterError,
            "has all its silhouettes",
            [*GUIDANCE, "silhouettes"],
        ),
        (request("longer legs", control={"regions": [{"node": "a"}]}), (), ParameterError, "has no regions", None),
        (request(), ("weights",), KindRetiredError, "no longer used", None),
    ],
)
def test_what_cannot_run_is_refused_with_its_place(
    asked: JobRequest, files: tuple[str, ...], error: type[MeshdeformError], words: str, place: list[Any] | None
) -> None:
    with pytest.raises(error, match=words) as caught:
        checked(asked, *files)
    assert place is None or [each["loc"] for each in caught.value.extra.get("errors", [{"loc": ["prompt"]}])] == [place]


def test_the_nearest_nouns_stand_in_for_free_text() -> None:
    with pytest.raises(VocabularyError) as caught:
        checked(request("a palace"))
    assert caught.value.extra["suggestions"] == ["a house", "a cabin"]


@pytest.mark.parametrize("name", sorted(OF_OPTIMISER))
def test_settings_of_the_optimiser_are_refused_by_name(name: str) -> None:
    with pytest.raises(ParameterError, match=rf"params\.{name} .* optimiser") as caught:
        checked(request(**{name: EXAMPLES[name]}))
    assert caught.value.extra["errors"][0]["loc"] == ["params", name]
    assert "kind to sds" in caught.value.advice_text


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("negative_prompt", "a chair"),
        ("model", "builtin"),
        ("guidance_scale", 7.5),
        ("appearance", "clay"),
        ("timestep_min", 0.1),
        ("silhouette_weight", 5.0),
        ("point_weight", 1.0),
    ],
)
def test_options_of_other_guidance_are_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(ParameterError, match=rf"params\.guidance\.{name}, where the guidance is .*Leave it out"):
        make_request("a giraffe", {"guidance": {"kind": "exemplar", name: value}})


def test_further_targets_are_for_exemplars_alone() -> None:
    asked = JobRequest.model_validate({"params": {"guidance": {"kind": "target"}}})
    with pytest.raises(ParameterError, match="nearest of several"):
        check_request(asked, Settings(), files=["asset", "target", "target_2"])


def test_a_strength_is_a_share_of_the_way() -> None:
    assert checked(request(strength=0.9)).strength == 0.9
    for strength in (-0.1, 1.1):
        with pytest.raises(ValueError, match="strength"):
            request(strength=strength)


def test_steps_are_those_of_the_prompts_and_none_of_a_change_in_plain_words() -> None:
    assert steps(request()) == STEPS
    assert steps(request(prompts=[{"prompt": "a cat"}, {"prompt": "a dog", "weight": 0.0}])) == 2 * STEPS
    assert steps(request("")) == STEPS  # to a target
    for change in ("longer legs", "twice as tall", "a fatter dog"):
        assert steps(request(change)) == 0
    assert steps(request("a fat dog", source_noun="dog")) == STEPS  # a description has an exemplar


def test_a_branch_inherits_the_targets_unless_it_has_a_prompt() -> None:
    kind = kind_of(request().kind)
    assert kind.inherits(request("")) == {"asset", *TARGET_FIELDS}
    assert kind.inherits(request("a cat")) == {"asset"}
    assert kind.inherits(request("", prompts=[{"prompt": "a cat"}])) == {"asset"}


def test_stored_requests_without_a_kind_stay_with_the_model() -> None:
    stored = read_stored({"prompt": "a mushroom", "params": {"seed": 3}})
    assert stored.params.kind is GuidanceKind.SDS


def test_the_check_loads_neither_torch_nor_numpy() -> None:
    code = (
        "import sys; from meshdeform.runs import check_request; from meshdeform.requests.document import JobRequest;"
        "from meshdeform.settings import Settings;"
        "asked = {'prompt': 'a giraffe', 'params': {'guidance': {'kind': 'exemplar'}}};"
        "check_request(JobRequest.model_validate(asked), Settings(), files=['asset']);"
        "print(sorted({'torch', 'numpy', 'scipy', 'numba'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stdout.strip() == "[]"


def test_a_branch_of_a_fit_is_a_fit() -> None:
    kind = kind_of(request().kind)
    other = JobRequest(prompt="a cat")
    assert kind.as_branch(request(), request("a cat")).prompt == "a cat"
    assert kind.as_branch(other, request("a dog")).params.kind is GuidanceKind.EXEMPLAR
    assert kind.as_branch(request(), other).params.kind is GuidanceKind.EXEMPLAR
    pushed = JobRequest.model_validate({"prompt": "a cat", "params": {"steps": 20}})
    with pytest.raises(ParameterError, match="no optimiser can go on"):
        kind.as_branch(request(), pushed)
