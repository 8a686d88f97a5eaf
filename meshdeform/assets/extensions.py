"""Say what becomes of every known extension when its asset is deformed: the table of docs/extensions.md.

A file that only uses an extension is always read. What stays true is kept; what would go stale is told; a file that
*requires* what can change the geometry in a way that is not understood is refused, as one with an unknown extension is.

Sources: the registry of Khronos (extensions/README.md of the glTF repository, July 2026) with its drafts; the
specifications of VRM 0 and 1; those of the Open Metaverse Interoperability group (OMI) and of Cesium's 3D Tiles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from meshdeform.assets.archive import listed
from meshdeform.assets.container import Json
from meshdeform.assets.unchecked import member_of, objects_in

__all__ = ["PREFIXES", "RULES", "Rule", "notices", "rule_of"]

_LOOKS = "what it says of colour, light or sound does not depend on the shape"
_BY_NUMBER = "vertices keep their numbers, and triangles their order; `output.subdivide` removes it, and says so"
_LATER = "what it plays later replaces what was deformed"
_MODIFY = "the licence of this avatar forbids changes (`modification: prohibited`, or a licence without derivatives)"
PREFIXES: tuple[str, ...] = (
    *("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_node_", "KHR_xmp", "EXT_texture_", "EXT_lights_"),
    *("EXT_materials_", "MSFT_texture_", "VRMC_materials_", "GODOT_", "AGI_"),
)
"""What the names of extensions begin with that say nothing of the shape, however new they are."""
_MOST = 5
"""How many names a sentence lists."""


@dataclass(frozen=True)
class Rule:
    """What becomes of some extensions."""

    names: tuple[str, ...]
    kept: str = ""  # what stays true, and how; empty: nothing of the shape does
    told: str = ""  # what a warning says of a file that uses it; empty: nothing needs to be said
    refused: str = ""  # why a file that requires it is refused; empty: it is not
    when: Callable[[Json], bool] | None = None  # whether there is something to tell of a file that uses it


def _meshes_shared(root: Json) -> bool:
    """Return whether a mesh stands on several nodes, which get a copy each."""
    shown = [node["mesh"] for node in objects_in(root.get("nodes")) if isinstance(node.get("mesh"), int)]
    return len(shown) > len(set(shown))


def _modification_prohibited(root: Json) -> bool:
    """Return whether the meta data of a VRM forbid to change it."""
    of_one, of_zero = (member_of(root, "extensions", name, "meta") for name in ("VRMC_vrm", "VRM"))
    return of_one.get("modification") == "prohibited" or str(of_zero.get("licenseName")).endswith("_ND")


def _split_manifold(root: Json) -> bool:
    """Return whether the primitives of a manifold mesh do not share their positions, as they must."""
    for mesh in objects_in(root.get("meshes")):
        solid = member_of(mesh, "extensions", "EXT_mesh_manifold", "manifoldPrimitive")
        used = {member_of(each, "attributes").get("POSITION") for each in objects_in(mesh.get("primitives"))}
        if solid and used != {member_of(solid, "attributes").get("POSITION")}:
            return True
    return False


RULES = (
    Rule(
        (
            *("KHR_materials_anisotropy", "KHR_materials_clearcoat", "KHR_materials_diffuse_transmission"),
            *("KHR_materials_dispersion", "KHR_materials_emissive_strength", "KHR_materials_ior"),
            *("KHR_materials_iridescence", "KHR_materials_sheen", "KHR_materials_specular", "KHR_materials_subsurface"),
            *("KHR_materials_transmission", "KHR_materials_unlit", "KHR_materials_variants"),
            *("KHR_materials_pbrSpecularGlossiness", "KHR_techniques_webgl", "KHR_texture_basisu"),
            *("KHR_texture_transform", "KHR_texture_procedurals", "KHR_texture_video", "KHR_xmp", "KHR_xmp_json_ld"),
            *("EXT_texture_webp", "EXT_texture_astc", "EXT_texture_avif", "EXT_texture_procedurals_mx_1_39"),
            *("EXT_lights_image_based", "ADOBE_materials_clearcoat_specular", "ADOBE_materials_clearcoat_tint"),
            *("ADOBE_materials_thin_transparency", "NV_materials_mdl", "MSFT_texture_dds"),
            *("MSFT_packing_normalRoughnessMetallic", "MSFT_packing_occlusionRoughnessMetallic"),
            *("MPEG_media", "MPEG_texture_video", "MPEG_animation_timing", "VRMC_materials_mtoon"),
            *("VRMC_materials_hdr_emissiveMultiplier", "VRMC_materials_override", "GODOT_single_root"),
        ),
        kept=_LOOKS,
    ),
    Rule(("KHR_materials_volume",), kept="`thicknessFactor` is in the mesh's units, and stays the source's"),
    Rule(
        ("KHR_lights_punctual", "EXT_lights_ies", "KHR_audio_emitter", "KHR_audio_graph", "MPEG_audio_spatial"),
        kept="its nodes go where the surface around them goes; ranges and intensities stay",
    ),
    Rule(
        ("KHR_node_visibility", "KHR_node_selectability", "KHR_node_hoverability", "AGI_stk_metadata"),
        kept="it names nodes, which keep their numbers",
    ),
    Rule(
        ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_mesh_quantization"),
        kept="decoded where it is deformed; replaced accessors become plain floats",
    ),
    Rule(("EXT_mesh_gpu_instancing",), kept="deformed once, in the place of the first instance"),
    Rule(("EXT_mesh_primitive_restart",), kept="strips and fans are read with it; indices stay"),
    Rule(("CESIUM_primitive_outline", "EXT_mesh_primitive_edge_visibility"), kept=_BY_NUMBER),
    Rule(
        ("EXT_mesh_manifold",),
        kept="`manifoldPrimitive` has the accessor that the primitives have",
        told="the primitives of a mesh do not share their positions, as it demands: of such a mesh it was removed",
        when=_split_manifold,
    ),
    Rule(
        ("KHR_animation_pointer",),
        kept="pointers to the weights of a mesh act on all its copies, and translations of nodes move along",
    ),
    Rule(
        ("KHR_interactivity",),
        kept="it names nodes, which keep their numbers",
        told="pointers of its graph to a mesh that stands on several nodes act on the first alone",
        when=_meshes_shared,
    ),
    Rule(("MSFT_lod",), kept="the levels, with what is below them, are deformed by the same map"),
    Rule(
        ("KHR_implicit_shapes", "EXT_implicit_shapes", "KHR_collision_shapes", "EXT_collision_shapes")
        + ("KHR_physics_rigid_bodies", "EXT_physics_rigid_bodies", "KHR_rigid_bodies")
        + ("MSFT_collision_primitives", "MSFT_rigid_bodies", "OMI_physics_shape", "OMI_physics_body"),
        kept="meshes are deformed by the same map; boxes, spheres, capsules and cylinders grow and go with the surface "
        "around them, if the rig follows",
        told="masses, centres of mass and joint limits stay the source's",
    ),
    Rule(
        ("OMI_collider", "OMI_physics_joint", "OMI_seat", "OMI_spawn_point", "OMI_vehicle_body", "OMI_vehicle_wheel"),
        kept="its nodes go where the surface around them goes",
        told="sizes and places in it stay the source's",
    ),
    Rule(
        ("EXT_mesh_features", "EXT_instance_features"),
        kept="features are named by vertex, texel or instance, which keep their numbers",
    ),
    Rule(
        ("EXT_structural_metadata", "GRIFFEL_bim_data"),
        kept="properties stay with their features",
        told="properties that were measured, such as sizes and areas, stay the source's",
    ),
    Rule(("FB_geometry_metadata",), kept="`sceneBounds` are computed again"),
    Rule(("AGI_articulations",), kept="it names nodes", told="its ranges of motion stay the source's"),
    Rule(("KHR_gaussian_splatting",), kept="splats follow as points", told="their rotations and scales stay"),
    Rule(
        ("KHR_gaussian_splatting_compression_spz", "KHR_gaussian_splatting_compression_spz_2"),
        told="what it compresses stays the source's",
        refused="its splats cannot be read",
    ),
    Rule(("KHR_accessor_float64",), refused="64-bit accessors cannot be read"),
    Rule(("MPEG_accessor_timed", "MPEG_buffer_circular", "MPEG_scene_dynamic"), told=_LATER, refused=_LATER),
    Rule(
        ("MPEG_mesh_linking",),
        told="the mesh that it links by correspondence is deformed only where the scene shows it",
    ),
    Rule(("MPEG_viewport_recommended",), told="views that it recommends stay those of the source"),
    Rule(("CESIUM_RTC",), kept="the origin stays"),
    Rule(
        ("VRMC_vrm", "VRM"),
        kept="expressions and first-person rules name all copies of a mesh; the point of view moves with the head",
        told=_MODIFY,
        when=_modification_prohibited,
    ),
    Rule(
        ("VRMC_springBone", "VRMC_springBone_extended_collider"),
        kept="colliders move and grow with the surface around them, radii of joints with them, if the rig follows",
    ),
    Rule(
        ("VRMC_node_constraint", "VRMC_springBone_limit", "VRMC_vrm_animation"),
        kept="rotations between nodes, which keep their numbers",
    ),
    Rule(
        ("VRMC_vrm_expressions_node_transform",),
        kept="it names nodes",
        told="translations of nodes in expressions stay the source's",
    ),
)

_LOOK = Rule((), kept=_LOOKS)
_BY_NAME = {name: rule for rule in RULES for name in rule.names}


def rule_of(name: str) -> Rule | None:
    """Return the rule for an extension; None if it is unknown."""
    return _BY_NAME.get(name) or (_LOOK if name.startswith(PREFIXES) else None)


def notices(root: Json) -> list[str]:
    """Return sentences about what a document's extensions and extras say of the shape, and will not be true."""
    used = [name for name in root.get("extensionsUsed", []) if isinstance(name, str)]
    told: dict[str, list[str]] = {}
    for name in used:
        rule = rule_of(name)
        if rule is None:
            told.setdefault("not known here, so what they say of the shape stays the source's", []).append(name)
        elif rule.told and (rule.when is None or rule.when(root)):
            told.setdefault(rule.told, []).append(name)
    sentences = [f"{listed(names, _MOST)}: {what}." for what, names in told.items()]
    numbered = sorted({name for holder in _extras(root) for name in _numbering(holder)}) if _meshes_shared(root) else []
    if numbered:
        sentences.append(
            f"Extras name meshes by number ({listed(numbered, _MOST)}), and a mesh stands on several nodes: each has "
            "its own then, and extras name the first alone."
        )
    return sentences


def _numbering(value: Any) -> Iterator[str]:
    """Yield the names of members of extras that seem to hold the numbers of meshes."""
    stack = [value]
    while stack:
        at = stack.pop()
        if isinstance(at, list):
            stack += at
        elif isinstance(at, dict):
            for key, item in at.items():
                first = item[0] if isinstance(item, list) and item else item
                if "mesh" in key.lower() and isinstance(first, int) and not isinstance(first, bool):
                    yield key
            stack += at.values()


def _extras(root: Json) -> Iterator[Any]:
    """Yield all extras of a document."""
    stack: list[Any] = [root]
    while stack:
        at = stack.pop()
        if isinstance(at, list):
            stack += at
        elif isinstance(at, dict):
            if "extras" in at:
                yield at["extras"]
            stack += [item for key, item in at.items() if key != "extras"]
