"""Made assets, and what Pixar's own library says of the packages that they become."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pxr import Usd, UsdGeom, UsdShade, UsdValidation

from meshdeform.assets import load_asset
from meshdeform.assets.usd import Usdz, write_usdz
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_VERTS, Builder

UVS = np.array([[0, 0], [1, 0], [0, 1], [0.75, 0.25]], np.float32)
COLORS = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0.25, 1, 0.5], [1, 1, 1, 1]], np.float32)


def picture(kind: str = "PNG", seed: int = 0) -> bytes:
    """Return an image of noise."""
    pixels = np.random.default_rng(seed).integers(0, 255, (8, 8, 3), np.uint8)
    with io.BytesIO() as file:
        Image.fromarray(pixels).save(file, kind, **({"lossless": True} if kind == "WEBP" else {}))
        return file.getvalue()


def textured(builder: Builder, image: bytes, **sampler: Any) -> int:
    """Add a texture of an image; return its index."""
    root = builder.root
    root.setdefault("images", []).append({"bufferView": builder.view(image)})
    root.setdefault("textures", []).append({"source": len(root["images"]) - 1})
    if sampler:
        root.setdefault("samplers", []).append(sampler)
        root["textures"][-1]["sampler"] = len(root["samplers"]) - 1
    return len(root["textures"]) - 1


def material(builder: Builder, **members: Any) -> int:
    """Add a material; return its index."""
    materials = builder.root.setdefault("materials", [])
    materials.append(members)
    return len(materials) - 1


def quad(builder: Builder, *, look: int | None = None, **attributes: Any) -> dict[str, Any]:
    """Return a quad with normals and UVs."""
    made = builder.primitive(QUAD_VERTS, QUAD_FACES, NORMAL=QUAD_NORMALS, TEXCOORD_0=UVS, **attributes)
    return made if look is None else {**made, "material": look}


class Stage:
    """A package that was made of a GLB and opened again; it has passed every validator."""

    def __init__(self, glb: bytes, folder: Path) -> None:
        self.asset = load_asset(glb)
        self.usdz: Usdz = write_usdz(self.asset.scene())
        # USD keeps layers by their path: each needs one of its own.
        self.path = folder / f"{len(list(folder.iterdir()))}.usdz"
        self.path.write_bytes(self.usdz.data)
        self.stage = Usd.Stage.Open(str(self.path))
        validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
        assert len(validators) > 10
        errors = UsdValidation.ValidationContext(validators).Validate(self.stage)
        assert [(error.GetName(), error.GetMessage()) for error in errors] == []

    @property
    def meshes(self) -> list[UsdGeom.Mesh]:
        """Every mesh, in the stage's order."""
        return [UsdGeom.Mesh(prim) for prim in self.stage.Traverse() if prim.IsA(UsdGeom.Mesh)]

    def corners(self) -> NDArray[np.float64]:
        """Corners of all triangles in the world, (T, 3, 3), counter-clockwise from outside."""
        found = []
        for mesh in self.meshes:
            matrix = np.array(UsdGeom.Xformable(mesh).ComputeLocalToWorldTransform(0))
            points = np.array(mesh.GetPointsAttr().Get(), np.float64) @ matrix[:3, :3] + matrix[3, :3]
            faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
            assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
            found.append(points[faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces])
        return np.concatenate(found)

    def primvar(self, mesh: int, name: str) -> NDArray[Any]:
        """Return a primvar's values; there is one for each point."""
        primvar = UsdGeom.PrimvarsAPI(self.meshes[mesh]).GetPrimvar(name)
        assert primvar.GetInterpolation() == "vertex"
        return np.array(primvar.Get())

    def surface(self, mesh: int = 0) -> UsdShade.Shader:
        """Return the surface shader that a mesh is bound to."""
        bound, _ = UsdShade.MaterialBindingAPI(self.meshes[mesh]).ComputeBoundMaterial()
        shader, _, _ = bound.ComputeSurfaceSource()
        assert shader.GetIdAttr().Get() == "UsdPreviewSurface"
        return shader

    def source(self, shader: UsdShade.Shader, name: str) -> tuple[UsdShade.Shader, str]:
        """Return the shader and the output that an input is connected to."""
        (found,), _ = shader.GetInput(name).GetConnectedSources()
        return UsdShade.Shader(found.source.GetPrim()), str(found.sourceName)

    def assert_same_shape(self) -> None:
        """Corner for corner, in the world, it is what the asset says."""
        surface = self.asset.surface
        np.testing.assert_allclose(self.corners(), surface.positions[surface.triangles], atol=1e-6)


def value(shader: UsdShade.Shader, name: str) -> Any:
    """Return an input's own value as plain numbers."""
    found = shader.GetInput(name).Get()
    return _numbers(found) if hasattr(found, "__len__") and not isinstance(found, str) else found


def _numbers(found: Any) -> list[float]:
    """Return a vector as a list."""
    return [float(each) for each in found]
