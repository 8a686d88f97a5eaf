"""Time Mitsuba 3 drawing a sphere from four sides, forward and backward: run by `bench/peers.py`.

    python3 -m venv mitsuba && mitsuba/bin/pip install mitsuba
    python -m bench.peers --only render --mitsuba mitsuba/bin/python

Needs no Meshdeform. Mitsuba compiles with LLVM 16 or newer (Debian: `libllvm19`; DRJIT_LIBLLVM_PATH names the library).
Its integrator `direct_projective` lights clay by one lamp and samples the silhouettes of what the camera sees, so that
gradients of the vertices are unbiased, as ours are by antialiasing. Shadows come with it, and noise, which depends on
the samples for each pixel. Prints the CPU seconds of one repetition, the smallest of five, as JSON.
"""

from __future__ import annotations

import importlib
import json
import math
import sys
import time

import numpy as np

# No requirements of this project: the environment that runs this file has them.
dr, mi = importlib.import_module("drjit"), importlib.import_module("mitsuba")


def icosphere(level: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return an icosahedron, divided `level` times, on a sphere."""
    g = (1 + math.sqrt(5)) / 2
    verts = [np.array(p, float) for p in [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]]
    verts += [np.array(p, float) for p in [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2)]
    faces += [(10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11)]
    faces += [(6, 2, 10), (8, 6, 7), (9, 8, 1)]
    for _ in range(level):
        middles: dict[tuple[int, int], int] = {}

        def middle(a: int, b: int, middles: dict[tuple[int, int], int] = middles) -> int:
            key = (min(a, b), max(a, b))
            if key not in middles:
                middles[key] = len(verts)
                verts.append((verts[a] + verts[b]) / 2)
            return middles[key]

        finer = []
        for a, b, c in faces:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = finer
    points = np.array(verts)
    return radius * points / np.linalg.norm(points, axis=1, keepdims=True), np.array(faces)


def main() -> None:
    """Measure with the level, radius, pixels and samples that the command line gives."""
    level, radius, pixels, samples = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    dr.set_thread_count(1)
    verts, faces = icosphere(level, radius)
    mesh = mi.Mesh("shape", len(verts), len(faces))
    filled = mi.traverse(mesh)
    filled["vertex_positions"] = verts.astype(np.float32).ravel()
    filled["faces"] = faces.astype(np.uint32).ravel()
    filled.update()
    sensors = [
        mi.load_dict(
            {
                "type": "perspective",
                "fov": 40.0,
                "to_world": mi.ScalarTransform4f().look_at(
                    [2.4 * math.sin(turn), 0.6, 2.4 * math.cos(turn)], [0, 0, 0], [0, 1, 0]
                ),
                "film": {"type": "hdrfilm", "width": pixels, "height": pixels, "rfilter": {"type": "box"}},
            }
        )
        for turn in np.radians([20, 110, 200, 290])
    ]
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct_projective", "sppi": 0},
            "lamp": {"type": "directional", "direction": [0.4, -0.6, -0.7], "irradiance": 3.0},
            "shape": mesh,
        }
    )
    params = mi.traverse(scene)
    key = next(name for name in params.keys() if name.endswith("vertex_positions"))  # noqa: SIM118  # no mapping

    def both(seed: int) -> None:
        leaf = mi.Float(params[key])
        dr.enable_grad(leaf)
        params[key] = leaf
        params.update()
        loss = mi.Float(0.0)
        for number, sensor in enumerate(sensors):
            image = mi.render(scene, params, sensor=sensor, spp=samples, seed=4 * seed + number)
            loss += dr.sum(dr.square(image), axis=None)
        dr.backward(loss)
        gradient = np.array(dr.grad(params[key]))
        assert np.abs(gradient).sum() > 0, "no gradient reached the vertices"

    both(0)  # compiles
    taken = []
    for seed in range(1, 6):
        begun = time.process_time()
        both(seed)
        taken.append(time.process_time() - begun)
    print(json.dumps({"cpu_s": min(taken)}))


if __name__ == "__main__":
    main()
