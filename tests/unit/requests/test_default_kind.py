"""The kind of guidance of a request that names none: by its options, its files, its prompt and the default model."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import pytest

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import BUILTIN_MODEL, GuidanceKind
from meshdeform.requests.default_kind import kind_like, with_kind
from meshdeform.requests.document import JobRequest, read_stored
from meshdeform.requests.parameters import (
    GUIDANCES,
    TARGET_FIELDS,
    CommonParams,
    ControlParams,
    ExemplarGuidanceParams,
    PromptGuidanceParams,
    TargetGuidanceParams,
)
from meshdeform.runs import check_request
from meshdeform.settings import Settings
from tests.cases import each_case

PROMPT = "a giraffe"
OF_FITS = ExemplarGuidanceParams.model_fields.keys() - {"kind"}
OF_MODELS = PromptGuidanceParams.model_fields.keys() - ExemplarGuidanceParams.model_fields.keys()


def example(model: Any, name: str) -> Any:
    return model.model_fields[name].examples[0]


def decided(
    params: dict[str, Any], prompt: str = PROMPT, files: Collection[str] = (), model: str = BUILTIN_MODEL
) -> JobRequest:
    asked = JobRequest.model_validate({"prompt": prompt, "params": params})
    return with_kind(asked, model, ["asset", *files])


def kind(params: dict[str, Any], *args: Any, **more: Any) -> str:
    return decided(params, *args, **more).params.kind.value


def test_a_prompt_alone_is_a_shape_and_the_request_says_so() -> None:
    request = decided({"seed": 3})
    assert request.model_dump(mode="json", exclude_unset=True) == {
        "prompt": PROMPT,
        "params": {"seed": 3, "guidance": {"kind": "exemplar"}},
    }
    assert request.workload == "text_deform/exemplar/"
    assert with_kind(request, "another/model", ["asset", "target"]) == request  # it is decided once
    change = decided({}, "longer legs")
    assert check_request(change, Settings(), files=["asset"]).model_dump()["guidance"] == "exemplar"


@each_case("name", sorted(OF_MODELS))
def test_what_only_a_model_has_means_sds(name: str) -> None:
    value = example(PromptGuidanceParams, name)
    request = decided({"guidance": {name: value}})
    assert request.params.guidance.model_dump(mode="json") == {"kind": "sds", name: value}


@each_case("name", sorted(CommonParams.model_fields))
def test_what_only_the_optimiser_has_means_sds(name: str) -> None:
    """A new parameter is the optimiser's, unless fits have a use for it."""
    fits = name in {"seed", "checkpoint_every_steps"}
    params = {name: example(CommonParams, name)}
    assert kind(params) == ("exemplar" if fits else "sds")
    assert kind({**params, "guidance": {"orientation": 90.0}}) == ("exemplar" if fits else "sds")
    # A target has it as well.
    assert kind(params, "", ["target"]) == "target"


@each_case("name", sorted(OF_FITS | ControlParams.model_fields.keys()))
def test_what_fits_have_is_left_to_them(name: str) -> None:
    group = {name: example(ExemplarGuidanceParams if name in OF_FITS else ControlParams, name)}
    params = {"guidance" if name in OF_FITS else "control": group}
    assert kind(params) == "exemplar"
    elsewhere = name in PromptGuidanceParams.model_fields or name in ControlParams.model_fields
    # A model that the operator has named is used wherever it can be.
    assert kind(params, model="some/checkpoint") == ("sds" if elsewhere else "exemplar")


@each_case("model", ["some/checkpoint", "/models/other.safetensors"])
def test_a_model_named_by_the_setting_means_sds(model: str) -> None:
    assert kind({}, model=model) == "sds"
    assert kind({}, "", ["target"], model) == "target"
    assert kind({"guidance": {"kind": "exemplar"}}, model=model) == "exemplar"


def test_files_say_what_to_become_where_no_prompt_does() -> None:
    views = {"guidance": {"silhouettes": [{"azimuth": 0.0}]}}
    assert kind({}, "", ["target"]) == "target"
    assert kind({"guidance": {"strength": 0.5}}, "", ["target"]) == "exemplar"
    assert kind({}, "", TARGET_FIELDS[:3]) == "exemplar"
    assert kind(views, "", ["silhouette_1"]) == "silhouettes"
    assert kind(views, PROMPT, ["silhouette_1"]) == "exemplar"
    assert kind({**views, "preset": "preview"}, PROMPT, ["silhouette_1"]) == "sds"
    further = {"guidance": {**views["guidance"], "prompts": [{"prompt": "a cat"}]}}
    assert kind(further, "", ["silhouette_1"]) == "exemplar"


def test_options_that_no_kind_has_together_are_refused_by_name() -> None:
    with pytest.raises(ParameterError, match="`sds` has no strength") as refused:
        decided({"guidance": {"strength": 0.5, "model": "builtin"}})
    assert refused.value.extra["errors"][0]["loc"] == ["params", "guidance", "strength"]
    assert "exemplar have it" in refused.value.advice_text
    with pytest.raises(ParameterError, match="has no model"):
        decided({"guidance": {"model": "builtin"}}, "", ["target"])


def test_a_kind_that_is_named_and_other_kinds_of_job_stay_as_they_are() -> None:
    for name, model in GUIDANCES.items():
        asked = JobRequest.model_validate({"prompt": PROMPT, "params": {"guidance": {"kind": name.value}}})
        assert isinstance(asked.params.guidance, model)
        assert with_kind(asked, BUILTIN_MODEL, ["asset"]) is asked
    other = JobRequest.model_validate({"kind": "surface_fit"})
    assert with_kind(other, BUILTIN_MODEL, ["surface"]) is other


@each_case("params", [{}, {"guidance": {}}, {"guidance": {"orientation": "auto"}}, {"steps": 3}])
def test_a_stored_request_without_a_kind_stays_sds(params: dict[str, Any]) -> None:
    request = read_stored({"prompt": PROMPT, "params": params})
    assert request.params.kind is GuidanceKind.SDS
    assert request.params.guidance.model_dump(mode="json")["kind"] == "sds"
    assert with_kind(request, BUILTIN_MODEL, ["asset"]) is request


@each_case(
    ("job", "branch", "prompt", "expected"),
    [
        ("exemplar", {}, PROMPT, "exemplar"),
        ("exemplar", {"guidance": {"strength": 0.5}}, PROMPT, "exemplar"),
        ("exemplar", {"steps": 20}, PROMPT, "sds"),
        ("sds", {}, PROMPT, "sds"),
        ("sds", {"guidance": {"negative_prompt": "fat"}}, PROMPT, "sds"),
        ("sds", {"guidance": {"kind": "exemplar"}}, PROMPT, "exemplar"),
        ("target", {"steps": 20}, "", "target"),
        ("target", {}, PROMPT, "sds"),
        ("silhouettes", {"guidance": {"silhouette_weight": 2.0}}, "", "silhouettes"),
    ],
)
def test_a_branch_has_the_kind_of_its_job_as_far_as_it_can(
    job: str, branch: dict[str, Any], prompt: str, expected: str
) -> None:
    of = JobRequest.model_validate({"params": {"guidance": {"kind": job}}})
    asked = JobRequest.model_validate({"prompt": prompt, "params": branch})
    assert kind_like(of, asked).params.kind == expected


def test_options_of_a_target_are_those_of_its_kind() -> None:
    for name in TargetGuidanceParams.model_fields.keys() - {"kind"}:
        assert kind({"guidance": {name: example(TargetGuidanceParams, name)}}, "", ["target"]) == "target"
