"""Pictures as targets over HTTP: what is found in them, and what is refused before a job exists."""

from __future__ import annotations

import json
from typing import Any

from meshdeform.requests.removed import grouped
from tests.integration.conftest import Api
from tests.integration.http_calls import check_problem
from tests.unit.runs.test_pictures import GLB, ellipse

ASKED = {"guidance": "silhouettes", "silhouettes": [{"azimuth": 0}, {"azimuth": 90}], "preset": "preview"}


def test_pictures_are_checked_with_their_job(api: Api) -> None:
    def sent(second: bytes, **params: Any) -> dict[str, Any]:
        return {
            "asset": ("a.glb", GLB),
            "silhouette_1": ("front.png", ellipse(40, 20)),
            "silhouette_2": ("side.png", second),
            "request": (None, json.dumps({"params": grouped({**ASKED, **params})})),
        }

    found = api.http.post("/v1/jobs:validate", files=sent(ellipse(20, 15)))
    assert found.status_code == 200, found.text
    pictures = found.json()["pictures"]
    assert list(pictures) == ["silhouette_1", "silhouette_2"]
    assert (pictures["silhouette_1"]["width"], pictures["silhouette_1"]["height"]) == (160, 120)
    assert list(found.json()["files"]) == ["asset"]
    problem = check_problem(api.http.post("/v1/jobs:validate", files=sent(b"no picture")), 422, "silhouette_unusable")
    assert "`silhouette_2`" in problem["detail"]
    once = sent(ellipse(20, 15), silhouettes=[{"azimuth": 0}])
    check_problem(api.http.post("/v1/jobs", files=once), 422, "parameter_invalid")
    job = api.http.post("/v1/jobs", files=sent(ellipse(20, 15)))
    assert job.status_code == 202
    assert list(job.json()["files"]) == ["asset", "silhouette_1", "silhouette_2"]
