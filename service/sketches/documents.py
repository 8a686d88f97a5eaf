"""Define the documents about drawings."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from meshdeform.requests.sketches import sketch_family

__all__ = ["SketchGuess", "SketchGuesses", "SketchParameter"]


class SketchParameter(BaseModel):
    """A parameter of a family: a number in a range, or one of several options."""

    name: str = Field(description="Its name.", examples=["lip"])
    value: float | str = Field(description="What the drawing shows.", examples=[0.2])
    default: float | str = Field(description="Its value where nothing is known.", examples=[0.16])
    minimum: float | None = Field(None, description="Of a number: the least value.", examples=[0.08])
    maximum: float | None = Field(None, description="Of a number: the greatest value.", examples=[0.3])
    options: list[str] | None = Field(None, description="Of a choice: its values.", examples=[None])


class SketchGuess(BaseModel):
    """One reading of a drawing."""

    family: str = Field(description="What it shows.", examples=["vase"])
    probability: float = Field(ge=0.0, le=1.0, description="That it shows this family and no other.", examples=[0.98])
    parameters: list[SketchParameter] = Field(description="All parameters of the family.")
    mesh: str = Field(
        description="The shape as a GLB, in base64.",
        examples=["Z2xURgIAAAA="],
        json_schema_extra={"contentEncoding": "base64", "contentMediaType": "model/gltf-binary"},
    )

    @classmethod
    def of(cls, found: dict[str, Any]) -> SketchGuess:
        """Return the document about a guess of `meshdeform.runs.sketch_process.guesses_of`."""
        family, values = sketch_family(found["family"]), found["values"]
        numbers = [
            SketchParameter(
                name=each.name, value=values[each.name], default=each.default, minimum=each.low, maximum=each.high
            )
            for each in family.numbers
        ]
        choices = [
            SketchParameter(name=each.name, value=values[each.name], default=each.default, options=list(each.options))
            for each in family.choices
        ]
        return cls(
            family=family.name, probability=found["probability"], parameters=numbers + choices, mesh=found["mesh"]
        )


class SketchGuesses(BaseModel):
    """What a drawing may show."""

    guesses: list[SketchGuess] = Field(description="The likeliest first: three, or one if the family is named.")
    unsure: bool = Field(
        description="Whether the drawing may be of none of the families: the first guess has a probability below 0.85, "
        "and no family was named.",
        examples=[False],
    )
