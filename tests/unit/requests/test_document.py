"""Parameters: presets, the paper's values, bounds, and what does not go together."""

from __future__ import annotations

from typing import Any, get_args

import pytest
from pydantic import BaseModel, ValidationError

from meshdeform.errors import ParameterError, UnreadableJobError
from meshdeform.requests.choices import RigMode
from meshdeform.requests.document import (
    PARAMS_OF_KIND,
    DeformParams,
    JobRequest,
    Preset,
    ResolvedParams,
    read_stored,
    read_unbounded,
    resolve,
)
from meshdeform.requests.groups import GROUPS, elsewhere, grouped, plain_location, without_unused
from meshdeform.requests.kind_folders import kind_table
from meshdeform.requests.parameters import CONSTANTS, FROM_PRESET, GUIDANCES, CommonParams, ControlParams
from meshdeform.runs import kinds
from tests.cases import each_case


def test_what_the_user_wrote_wins_over_the_preset_and_alone_is_said_again() -> None:
    written = {"preset": "preview", "steps": 5000, "guidance": {"guidance_scale": 3.0}}
    asked = DeformParams.model_validate(written)
    resolved = resolve(asked)
    assert (resolved.steps, resolved.guidance_scale, resolved.preset) == (5000, 3.0, Preset.PREVIEW)
    assert resolve(DeformParams(preset=Preset.PREVIEW)).steps == 60
    assert asked.model_dump(mode="json", exclude_unset=True).keys() == written.keys()


def test_the_paper_is_the_paper() -> None:
    resolved = resolve(DeformParams.model_validate({"preset": "paper", "guidance": {"model": "some/checkpoint"}}))
    assert resolved.steps == 5000
    assert resolved.learning_rate == 0.0025
    assert resolved.guidance_scale == 100
    assert (resolved.timestep_min, resolved.timestep_max, resolved.timestep_max_end) == (0.02, 0.98, 0.98)
    assert (resolved.fov_min_deg, resolved.fov_max_deg) == (30, 45)
    assert (resolved.elevation_min_deg, resolved.elevation_max_deg) == (0, 30)
    assert resolved.carrier == "surface"


@each_case("preset", list(Preset))
@each_case("guidance", ["sds", "target"])
@each_case("model", [None, "some/checkpoint"])
def test_every_combination_resolves_to_values_that_the_request_would_accept(preset, guidance, model) -> None:
    asked = without_unused(grouped({"preset": preset, "guidance": guidance, "model": model}))
    resolved = resolve(DeformParams.model_validate(asked))
    again = without_unused(grouped(resolved.model_dump(mode="json", exclude=set(CONSTANTS))))
    assert resolve(DeformParams.model_validate(again)) == resolved
    assert set(resolved.model_dump()) == set(ResolvedParams.model_fields) == {"guidance", *GROUPS, *CONSTANTS}


def test_the_front_is_a_word_or_an_angle() -> None:
    def orientation(**params: object) -> object:
        return resolve(DeformParams.model_validate(grouped(params))).orientation

    assert (orientation(), orientation(preset="paper")) == ("auto", "keep")
    assert (orientation(model="some/checkpoint"), orientation(guidance="target")) == ("keep", "keep")
    assert (orientation(orientation=-45), orientation(orientation="90")) == (-45.0, 90.0)


def test_only_stable_diffusion_sees_colours() -> None:
    def appearance(**params: object) -> str:
        return resolve(DeformParams.model_validate(grouped(params))).appearance.value

    assert (appearance(), appearance(guidance="target")) == ("normals", "normals")
    assert (appearance(model="a/b"), appearance(model="a/b", preset="paper")) == ("mixed", "clay")
    assert (appearance(model="a/b", appearance="textured"), appearance(appearance="normals")) == ("textured", "normals")
    with pytest.raises(ParameterError, match="pictures of normals") as caught:
        appearance(appearance="textured")
    assert caught.value.extra["errors"][0]["loc"] == ["params", "guidance", "appearance"]


@each_case(
    "bad",
    [
        {"steps": 0},
        {"steps": 10**9},
        {"learning_rate": 0.0},
        {"learning_rate": float("nan")},
        {"colour": "red"},
        {"guidance": {"model": ""}},
        {"guidance": {"kind": "words"}},
        {"guidance": "target"},
        {"guidance": {"kind": "target", "guidance_scale": 7.5}},
        {"guidance": {"kind": "silhouettes", "align": "none"}},
        {"guidance_scale": 7.5},
        {"regions": []},
        {"seed": -1},
        {"preset": "fast"},
        {"guidance": {"orientation": "left"}},
        {"guidance": {"orientation": 400}},
        {"guidance": {"appearance": "shiny"}},
    ],
)
def test_bad_values_and_unknown_names_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        DeformParams.model_validate(bad)


def test_a_timestep_above_those_of_the_preset_is_told_with_what_to_do() -> None:
    for params, highest in (({"timestep_min": 0.985}, "0.98"), ({"timestep_min": 0.6, "model": "a/b"}, "0.5")):
        with pytest.raises(ParameterError, match="timestep_min") as caught:
            resolve(DeformParams.model_validate(grouped(params)))
        assert f"at most {highest}" in caught.value.advice_text


def test_null_means_left_out_where_the_preset_decides_and_nowhere_else() -> None:
    nulls = dict.fromkeys([*FROM_PRESET, "model"])
    for kind, model in GUIDANCES.items():
        own = {name: None for name in nulls if name in model.model_fields or name in CommonParams.model_fields}
        read = DeformParams.model_validate(grouped({"guidance": kind, **own}))
        assert read.flat() == {}
        assert resolve(read) == resolve(DeformParams.model_validate({"guidance": {"kind": kind}}))
    for name in {"guidance", "control", *GROUPS} - {*nulls, "source_noun"}:
        with pytest.raises(ValidationError):
            DeformParams.model_validate(grouped({name: None}) if name in GROUPS else {name: None})


def test_the_schema_claims_no_default_where_the_preset_decides() -> None:
    for mode in ("validation", "serialization"):
        for model in (CommonParams, ControlParams, *GUIDANCES.values()):
            for name, member in model.model_json_schema(mode=mode)["properties"].items():
                assert ("default" in member) == (name not in FROM_PRESET) or name == "kind", name
                if name in FROM_PRESET:
                    assert "Default: the preset's. Paper: " in member["description"]
                    assert {"type": "null"} in member["anyOf"]
    resolved = ResolvedParams.model_json_schema(mode="serialization")
    assert set(resolved["required"]) == set(resolved["properties"]) == set(ResolvedParams.model_fields)
    nullable = {name for name, member in resolved["properties"].items() if {"type": "null"} in member.get("anyOf", [])}
    assert nullable == {"source_noun"}  # none is made


def test_what_is_in_a_group_now_is_said_with_its_place() -> None:
    for place, words in (
        (["params", "guidance_scale"], "it is params.guidance.guidance_scale, where the guidance is sds."),
        (
            ["params", "guidance", "target", "silhouettes"],
            "where the guidance is sds, silhouettes or exemplar. "
            "Leave it out, or the kind, or set params.guidance.kind.",
        ),
        (["params", "guidance", "sds", "handles"], "it is params.control.handles."),
        (["params", "control", "steps"], "it is params.steps."),
    ):
        assert (elsewhere(place) or "").endswith(words), place
    for unknown in (["params", "wobble"], ["params", "control", "regions", 0, "steps"], ["metadata", "steps"]):
        assert elsewhere(unknown) is None
    assert plain_location(("params", "guidance", "sds", "prompts", 0)) == ["params", "guidance", "prompts", 0]


def examples(model: type[BaseModel]) -> list[dict[str, Any]]:
    """Documents with one member each, as its documentation has them."""
    required = {
        name: field.examples[0] for name, field in model.model_fields.items() if field.is_required() and field.examples
    }
    if "kind" in model.model_fields and model.model_fields["kind"].is_required():
        required["kind"] = get_args(model.model_fields["kind"].annotation)[0]
    return [
        {**required, name: example} for name, field in model.model_fields.items() for example in field.examples or []
    ]  # fmt: skip


def test_what_the_door_takes_is_read_as_at_the_door() -> None:
    assert [kind.params for kind in kinds()] == list(PARAMS_OF_KIND.values())
    seen = 0
    for model in (*PARAMS_OF_KIND.values(), *GUIDANCES.values(), ControlParams, JobRequest):
        for document in examples(model):
            read, taken = read_unbounded(model, document), model.model_validate(document)
            assert read == taken
            assert read.model_fields_set == taken.model_fields_set
            assert read.model_dump(mode="json", exclude_unset=True) == taken.model_dump(mode="json", exclude_unset=True)
            seen += 1
    assert seen > 55


@each_case(
    "params",
    [
        {"steps": 10**9},
        {"learning_rate": 50.0},
        {"seed": -1},
        {"negative_prompt": "x" * 10_000},
        {"orientation": 720.0},
        {"regions": [{"node": "n" * 1000}] * 200},
        {"handles": [{"position": [0, 0, 0], "to": [0, 1, 0]}] * 500},
        {"prompts": [{"prompt": "p" * 5000, "weight": 1e9}]},
    ],
)
def test_bounds_are_for_the_door_alone(params: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        DeformParams.model_validate(grouped(params))
    stored = grouped(params)
    read = read_stored({"prompt": "x" * 9000, "params": stored, "priority": 10**6, "metadata": {"n" * 99: "v" * 999}})
    assert set(read.params.flat()) == set(params)
    assert read.params.model_dump(mode="json", exclude_unset=True).keys() == {*stored, "guidance"}
    assert resolve(read.params).model_dump(mode="json", exclude_unset=True)
    assert read_unbounded(ResolvedParams, {**resolve(DeformParams()).model_dump(), "steps": 10**9}).steps == 10**9


@each_case(
    ("params", "reason"),
    [
        ({"wobble": 1}, "params.wobble: there is no such member"),
        (
            {"control": {"regions": [{"node": "Lid", "wobble": 1}]}},
            "params.control.regions.0.wobble: there is no such member",
        ),
        ({"preset": "ultra"}, "params.preset: Input should be"),
        ({"steps": "many"}, "params.steps: Input should be a valid integer"),
        ({"guidance": {"kind": "target", "align": "matrix"}}, "params.guidance"),
        ({"control": {"regions": [{"node": "Lid", "material": "wood"}]}}, "exactly one of"),
        ([], "params: Input should be a valid dictionary"),
    ],
)
def test_what_is_not_understood_is_said_with_its_place(params: Any, reason: str) -> None:
    with pytest.raises(UnreadableJobError) as refused:
        read_stored({"prompt": "a vase", "params": params})
    assert reason in refused.value.detail


@each_case("kind, name", [(kind, name) for kind, names in kind_table("params", "RETIRED").items() for name in names])
def test_a_stored_request_is_read_without_parameters_that_are_gone(kind: str, name: str) -> None:
    stored = read_stored({"kind": kind, "params": {name: 0.5, "seed": 7}})
    assert stored.model_dump(exclude_unset=True)["params"] == {"seed": 7}
    with pytest.raises(ValidationError):  # a new one is refused
        JobRequest.model_validate({"kind": kind, "params": {name: 0.5}})


def test_the_rig_follows_unless_a_request_says_otherwise_or_is_older_than_that() -> None:
    assert JobRequest(prompt="a vase").output.rig is RigMode.FOLLOW
    assert JobRequest.model_validate({"prompt": "a vase", "output": {"rig": "keep"}}).output.rig is RigMode.KEEP
    # Requests name the rig when they are stored.
    for rig in RigMode:
        stored = read_stored({"prompt": "a vase", "output": {"rig": rig.value, "morph": True}}).output
        assert (stored.rig, stored.morph, "rig" in stored.model_fields_set) == (rig, True, True)
    # One without it was accepted when prompts kept the rig. It is not set: changes in plain words moved it.
    older = read_stored({"prompt": "a vase", "output": {"morph": True}}).output
    assert (older.rig, older.morph, older.model_fields_set) == (RigMode.KEEP, True, {"morph"})
    assert read_stored({"kind": "surface_fit"}).model_fields_set == {"kind", "params"}


@each_case("kind", ["image_deform", None, 3, {}, []])
def test_an_unknown_kind_is_no_kind_whatever_its_type(kind: Any) -> None:
    with pytest.raises(UnreadableJobError, match="no kind of job"):
        read_stored({"kind": kind, "params": {}})
    with pytest.raises(ValidationError):
        JobRequest.model_validate({"kind": kind, "prompt": "a mushroom"})


@each_case("bad", [{"prompt": "a" * 1001}, {"metadata": {"": "x"}}, {"metadata": {"k": "v" * 501}}])
def test_requests_are_stripped_and_bounded(bad: dict[str, Any]) -> None:
    assert JobRequest(prompt="  a vase ").prompt == "a vase"
    with pytest.raises(ValidationError):
        JobRequest.model_validate(bad)


def test_the_classes_of_a_request_end_in_params() -> None:
    """A request of a user and what a run makes of it, `HandleParams` and `Handles`, are told apart by their names."""
    requested: set[type[BaseModel]] = set()

    def visit(annotation: Any) -> None:
        for each in get_args(annotation):
            visit(each)
        if isinstance(annotation, type) and issubclass(annotation, BaseModel) and annotation not in requested:
            requested.add(annotation)
            for field in annotation.model_fields.values():
                visit(field.annotation)

    for params in (*PARAMS_OF_KIND.values(), JobRequest):
        visit(params)
    requested.discard(JobRequest)
    assert len(requested) > 20
    assert [each.__name__ for each in requested if not each.__name__.endswith("Params")] == []
