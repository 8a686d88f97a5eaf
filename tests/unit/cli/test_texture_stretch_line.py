"""The line that `meshdeform run` prints about the texture."""

from __future__ import annotations

from meshdeform.cli.report_lines import stretch_line


def test_the_line_names_median_percentile_and_share() -> None:
    found = {"p50": 1.034, "p95": 2.5, "above_2": 0.094, "scale": 1.2, "measured": 1.0}
    assert stretch_line(found) == (
        "Texture stretch: 1.03 at the median, 2.50 at the 95th percentile; 9% of the textured surface above 2"
    )
