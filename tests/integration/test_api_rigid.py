"""Parts, nodes, places and pictures that a request names are checked with its asset over HTTP."""

from __future__ import annotations

import json
from typing import Any

from meshdeform.assets import build_glb
from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.groups import grouped
from tests.integration.conftest import Api
from tests.integration.http_calls import check_document, check_problem
from tests.unit.runs.test_pictures import GLB, ellipse


def validate(api: Api, asset: bytes, **params: Any) -> Any:
    request = json.dumps({"prompt": "a mushroom", "params": grouped(params)})
    return api.http.post("/v1/jobs:validate", files={"asset": ("a.glb", asset), "request": (None, request)})


def test_an_unknown_part_is_refused_with_the_nearest_name(api: Api, openapi: dict[str, Any]) -> None:
    asset = build_glb(icosphere(2).verts, icosphere(2).faces, material="rubber")
    found = validate(api, asset, rigid=[{"material": "rubber", "mode": "similarity"}])
    assert found.status_code == 200, found.text
    check_document(found.json(), "Validation", openapi)
    assert found.json()["asset"]["materials"] == [{"index": 0, "name": "rubber"}]
    assert found.json()["asset"]["warnings"] == []
    assert found.json()["params"]["rigid"][0]["mode"] == "similarity"
    problem = check_problem(validate(api, asset, rigid=[{"material": "Rubber"}]), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["params", "control", "rigid", 0, "material"]
    problem = check_problem(validate(api, asset, regions=[{"material": "Rubber"}]), 422, "parameter_invalid")
    assert "Did you mean 'rubber'?" in problem["advice"]
    assert problem["errors"][0]["loc"] == ["params", "control", "regions", 0, "material"]
    control = {"regions": [{"material": "rubber", "action": "only"}], "symmetry": "auto"}
    found = validate(api, asset, **control)
    check_document(found.json(), "Validation", openapi)
    assert found.json()["params"]["regions"][0]["action"] == "only"
    assert found.json()["asset"]["mesh_names"] == [{"index": 0, "name": ""}]
    check_problem(validate(api, asset, rigid=[{"component": 0}], carrier="surface"), 422, "parameter_invalid")
    check_problem(validate(api, asset, rigid=[{"mode": "rigid"}]), 422, "parameter_invalid")


def test_numbers_beyond_the_file_are_refused_where_they_stand(api: Api) -> None:
    ball = icosphere(2)
    asset = build_glb(ball.verts, ball.faces)
    faces, verts = len(ball.faces), len(ball.verts)

    def refused_at(output: dict[str, Any], params: dict[str, Any]) -> list[Any] | None:
        files: dict[str, Any] = {"asset": ("a.glb", asset)}
        request = {"params": params, "output": output}
        if "guidance" in params:
            files["target"] = ("b.glb", asset)
        else:
            request["prompt"] = "a mushroom"
        files["request"] = (None, json.dumps(request))
        answer = api.http.post("/v1/jobs:validate", files=files)
        if answer.status_code == 200:
            return None
        return list(check_problem(answer, 422, "parameter_invalid")["errors"][0]["loc"][1:])

    def landmark(source: int, target: int) -> dict[str, Any]:
        return {"guidance": {"kind": "target", "landmarks": [{"source": source, "target": target}]}}

    to = {"to": [0.0, 1.2, 0.0]}
    for more in (0, 1):  # the last one that there is, and one more
        last, vertex = faces - 1 + more, verts - 1 + more
        for params, place in (
            ({"control": {"regions": [{"faces": [0, [5, last]]}]}}, ["control", "regions", 0, "faces"]),
            ({"control": {"rigid": [{"faces": [last]}]}}, ["control", "rigid", 0, "faces"]),
            ({"control": {"handles": [{"vertex": vertex, **to}]}}, ["control", "handles", 0, "vertex"]),
            (landmark(vertex, 0), ["guidance", "landmarks", 0, "source"]),
        ):
            assert refused_at({}, params) == (place if more else None)
            assert refused_at({"subdivide": True}, params) is None, "numbers are those after subdivision"
        target = ["guidance", "landmarks", 0, "target"] if more else None
        assert refused_at({"subdivide": True}, landmark(0, vertex)) == target


# Pictures as targets over HTTP: what is found in them, and what is refused before a job exists.


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
