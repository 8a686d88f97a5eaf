"""Parameters: presets, the paper's values, bounds, and what does not go together."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from meshdeform.errors import ParameterError
from meshdeform.requests.document import DeformParams, JobRequest, Preset, ResolvedParams, resolve
from tests.cases import each_case


def test_what_the_user_wrote_wins_over_the_preset() -> None:
    resolved = resolve(DeformParams.model_validate({"preset": "preview", "steps": 7, "guidance_scale": 3.0}))
    assert resolved.steps == 7
    assert resolved.guidance_scale == 3.0
    assert resolved.preset is Preset.PREVIEW


def test_the_paper_is_the_paper() -> None:
    resolved = resolve(DeformParams.model_validate({"preset": "paper", "model": "some/checkpoint"}))
    assert resolved.steps == 5000
    assert resolved.learning_rate == 0.0025
    assert resolved.guidance_scale == 100
    assert (resolved.timestep_min, resolved.timestep_max, resolved.timestep_max_end) == (0.02, 0.98, 0.98)
    assert (resolved.fov_min_deg, resolved.fov_max_deg) == (30, 45)
    assert (resolved.elevation_min_deg, resolved.elevation_max_deg) == (0, 30)
    assert resolved.translation_rate == 0


@each_case("preset", list(Preset))
@each_case("guidance", ["sds", "target"])
@each_case("model", [None, "some/checkpoint"])
def test_every_combination_resolves_to_values_that_the_request_would_accept(preset, guidance, model) -> None:
    resolved = resolve(DeformParams.model_validate({"preset": preset, "guidance": guidance, "model": model}))
    again = DeformParams.model_validate(resolved.model_dump())
    assert resolve(again) == resolved
    assert set(DeformParams.model_fields) == set(ResolvedParams.model_fields)


def test_the_preview_has_the_steps_that_it_promises() -> None:
    assert resolve(DeformParams(preset=Preset.PREVIEW)).steps == 80


@each_case(
    "bad",
    [
        {"steps": 0},
        {"steps": 10**9},
        {"learning_rate": 0.0},
        {"learning_rate": float("nan")},
        {"timestep_min": 0.9, "timestep_max": 0.5},
        {"fov_min_deg": 60, "fov_max_deg": 30},
        {"colour": "red"},
        {"model": ""},
        {"seed": -1},
        {"preset": "fast"},
    ],
)
def test_bad_values_and_unknown_names_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        DeformParams.model_validate(bad)


def test_a_bound_against_the_preset_is_told_with_what_to_do() -> None:
    with pytest.raises(ParameterError, match="timestep_min") as caught:
        resolve(DeformParams(timestep_max=0.5))
    assert "timestep_min" in caught.value.advice_text


def test_requests_are_stripped_and_bounded() -> None:
    assert JobRequest(prompt="  a vase ").prompt == "a vase"
    for bad in ({"prompt": "a" * 1001}, {"metadata": {"": "x"}}, {"metadata": {"k": "v" * 501}}, {"kind": "cook"}):
        with pytest.raises(ValidationError):
            JobRequest.model_validate(bad)
