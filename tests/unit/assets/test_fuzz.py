"""Whatever is done to a file, loading it gives an asset or a clear refusal, and takes no memory by its word.

The damage and the verdict are those of `bench/fuzz.py`, which does as many as one likes;
`tests/integration/test_fuzz.py` does more of them under the memory limit of the service.
"""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from bench import fuzz
from tests.unit.assets.builders import QUAD_NORMALS, QUAD_VERTS
from tests.unit.assets.test_replace import rich

SEED = 20_260_202
MUTANTS = 100
MAX_MEMORY = 64 * 2**20


def kitchen_sink() -> bytes:
    """One small file with a skin, instances, a sparse accessor, targets, an animation and a strip."""
    builder = rich()
    strip = {**builder.primitive(faces=np.arange(4, dtype=np.uint8)), "mode": 5}
    strip["targets"] = [{"POSITION": builder.accessor(QUAD_VERTS, bounds=True)}]
    weights = np.eye(4, dtype=np.float32)[[0] * 4]
    sparse = builder.primitive(NORMAL=QUAD_NORMALS, JOINTS_0=np.zeros((4, 4), np.uint8), WEIGHTS_0=weights)
    builder.root["accessors"][sparse["attributes"]["POSITION"]]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": builder.view(np.array([1, 3], np.uint16).tobytes()), "componentType": 5123},
        "values": {"bufferView": builder.view(QUAD_VERTS[[1, 3]].tobytes())},
    }
    mesh = builder.mesh(strip, weights=[0.5])
    child = builder.node(mesh, in_scene=False, scale=[1, -1, 1])
    joint = builder.node(children=[child], rotation=[0, 0, 0, 1])
    builder.root["skins"] = [
        {"joints": [joint], "inverseBindMatrices": builder.accessor(np.eye(4, dtype=np.float32).reshape(1, 16))}
    ]
    builder.node(builder.mesh(sparse), skin=0)
    builder.node(0, matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 2, 0, 0, 1])
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    sampler = {"input": times, "output": builder.accessor(np.array([0, 1], np.float32))}
    channel = {"sampler": 0, "target": {"node": child, "path": "weights"}}
    builder.root["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    return builder.glb((b"XTRA", b"abcd"))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numpy remarks on the infinite normals of some
def test_a_damaged_file_is_an_asset_or_a_clear_refusal_and_takes_little_memory() -> None:
    outcomes = set()
    for number in range(MUTANTS):
        name, data = fuzz.mutant(SEED, number)
        tracemalloc.start()
        try:
            outcomes.add(fuzz.outcome(name, data))
            _, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert peak < MAX_MEMORY, (number, peak)
    assert {"accepted", "asset_invalid", "asset_truncated"} <= outcomes
