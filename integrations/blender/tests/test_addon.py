"""Test the add-on in a real Blender with a real service: what it changes in a scene, and what it leaves alone."""

from __future__ import annotations

import time
from types import MethodType, SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

STEPS = 5


def select(*objects: Any) -> None:
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in objects)
    bpy.context.view_layer.objects.active = objects[0]


def monkey(name: str = "Suzanne", **where: Any) -> Any:
    bpy.ops.mesh.primitive_monkey_add(**where)
    bpy.context.object.name = name
    return bpy.context.object


def ball(name: str = "Ball") -> Any:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2)
    bpy.context.object.name = name
    return bpy.context.object


def towards(scene: Any, target: Any, how: str = "SHAPE_KEY", steps: int = STEPS) -> None:
    scene.meshdeform.guidance, scene.meshdeform.target = "target", target
    scene.meshdeform.steps, scene.meshdeform.seed, scene.meshdeform.apply = steps, 3, how


def coordinates(points: Any) -> np.ndarray:
    found = np.empty(3 * len(points), np.float32)
    points.foreach_get("co", found)
    return found.reshape(-1, 3)


def rig(obj: Any) -> Any:
    """Put an object on an armature of two bones, with weights, UVs, a material, a modifier and a shape key."""
    bpy.ops.object.armature_add()
    armature = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    first = armature.data.edit_bones[0]
    second = armature.data.edit_bones.new("Upper")
    second.head, second.tail, second.parent = first.tail, (0, 0, 2), first
    bpy.ops.object.mode_set(mode="OBJECT")
    for bone in ("Bone", "Upper"):
        group = obj.vertex_groups.new(name=bone)
        for vertex in obj.data.vertices:
            group.add([vertex.index], 0.25 if bone == "Bone" else 0.75, "REPLACE")
    modifier = obj.modifiers.new("Armature", "ARMATURE")
    modifier.object = armature
    obj.modifiers.new("Subdivision", "SUBSURF").levels = 1
    obj.data.materials.append(bpy.data.materials.new("Red"))
    obj.shape_key_add(name="Basis")
    smile = obj.shape_key_add(name="Smile", from_mix=False)
    smile.data[0].co.x += 0.5
    smile.value = 0.25
    return armature


def kept(obj: Any) -> dict[str, Any]:
    """Return everything that a deformation must leave alone."""
    uvs = np.empty(2 * len(obj.data.loops), np.float32)
    obj.data.uv_layers[0].data.foreach_get("uv", uvs)
    corners = np.empty(len(obj.data.loops), np.int32)
    obj.data.loops.foreach_get("vertex_index", corners)
    return {
        "uvs": uvs.tobytes(),
        "corners": corners.tobytes(),
        "materials": [material.name for material in obj.data.materials],
        "groups": [group.name for group in obj.vertex_groups],
        "weights": [[(each.group, each.weight) for each in vertex.groups] for vertex in obj.data.vertices],
        "modifiers": [(modifier.name, modifier.type) for modifier in obj.modifiers],
        "matrix": [list(row) for row in obj.matrix_world],
    }


def result_on_the_server(server: str, part: Any) -> np.ndarray:
    """Download the last job's result and return its positions."""
    from meshdeform_blender.client import Client
    from meshdeform_blender.glb import read_positions

    client = Client(server)
    job = client._json("GET", "/v1/jobs?state=succeeded&limit=1")["jobs"][0]
    return read_positions(client.artifact(job["id"], "result.glb"), [part])[0]


def test_the_result_becomes_a_shape_key_with_exactly_the_values_that_the_server_has(scene: Any, server: str) -> None:
    from meshdeform_blender import meshes

    target, suzanne = ball(), monkey(location=(5, 1, 0), rotation=(0.3, 0.2, 0.1), scale=(1, 2, 0.5))
    bpy.context.view_layer.update()
    before, others = coordinates(suzanne.data.vertices), kept(suzanne)
    part = meshes.gather([suzanne])[0].part
    select(suzanne)
    towards(scene, target)
    assert bpy.ops.meshdeform.deform() == {"FINISHED"}
    basis, key = suzanne.data.shape_keys.key_blocks
    assert (basis.name, key.name, key.value, suzanne.active_shape_key_index) == ("Basis", "Ball", 1.0, 1)
    np.testing.assert_array_equal(coordinates(basis.data), before)
    np.testing.assert_array_equal(coordinates(key.data), result_on_the_server(server, part))
    assert np.abs(coordinates(key.data) - before).max() > 1e-3
    assert kept(suzanne) == others
    evaluated = suzanne.evaluated_get(bpy.context.evaluated_depsgraph_get())
    np.testing.assert_allclose(coordinates(evaluated.data.vertices), coordinates(key.data), atol=1e-6)


@pytest.mark.parametrize("how", ["SHAPE_KEY", "REPLACE"])
def test_a_rigged_mesh_keeps_its_rig_and_its_shape_keys(scene: Any, how: str) -> None:
    target, suzanne = ball(), monkey()
    rig(suzanne)
    others, keys = kept(suzanne), suzanne.data.shape_keys.key_blocks
    basis, smile = coordinates(keys["Basis"].data), coordinates(keys["Smile"].data)
    select(suzanne)
    towards(scene, target, how)
    assert bpy.ops.meshdeform.deform() == {"FINISHED"}
    assert kept(suzanne) == others
    keys = suzanne.data.shape_keys.key_blocks
    assert keys["Smile"].value == 0.25
    if how == "SHAPE_KEY":
        assert [key.name for key in keys] == ["Basis", "Smile", "Ball"]
        np.testing.assert_array_equal(coordinates(keys["Basis"].data), basis)
        np.testing.assert_array_equal(coordinates(keys["Smile"].data), smile)
        return
    assert [key.name for key in keys] == ["Basis", "Smile"]
    after = coordinates(keys["Basis"].data)
    assert np.abs(after - basis).max() > 1e-3
    np.testing.assert_allclose(coordinates(keys["Smile"].data) - after, smile - basis, atol=1e-6)
    np.testing.assert_array_equal(coordinates(suzanne.data.vertices), after)


def test_several_objects_are_deformed_together_each_in_its_own_space(scene: Any) -> None:
    target = ball()
    first, second = monkey("A"), monkey("B", location=(3, 0, 0))
    twin = bpy.data.objects.new("Twin", first.data)
    scene.collection.objects.link(twin)
    select(first, second, twin)
    towards(scene, target, "REPLACE")
    before = [coordinates(obj.data.vertices) for obj in (first, second)]
    assert bpy.ops.meshdeform.deform() == {"FINISHED"}
    for obj, old in zip((first, second), before, strict=True):
        assert np.abs(coordinates(obj.data.vertices) - old).max() > 1e-3
    assert twin.data == first.data


def test_a_vertex_group_stays_and_an_empty_takes_a_point_along(scene: Any) -> None:
    target, suzanne = ball(), monkey(location=(0.5, 0, 0))
    before = coordinates(suzanne.data.vertices)
    group = suzanne.vertex_groups.new(name="Ear")
    inside = before[:, 0] > 0.3
    group.add(np.flatnonzero(inside).tolist(), 1.0, "REPLACE")
    held = int(np.argmin(before[:, 0]))
    scene.cursor.location = suzanne.matrix_world @ suzanne.data.vertices[held].co
    assert bpy.ops.meshdeform.add_handle() == {"FINISHED"}
    [empty] = scene.meshdeform.handles.objects
    empty.location.x -= 0.4
    select(suzanne)
    towards(scene, target, "REPLACE")
    scene.meshdeform.region, scene.meshdeform.group = "keep", "Ear"
    assert bpy.ops.meshdeform.deform() == {"FINISHED"}
    after = coordinates(suzanne.data.vertices)
    triangles = np.array([triangle.vertices for triangle in suzanne.data.loop_triangles])
    kept_vertices = np.unique(triangles[inside[triangles].all(1)])
    np.testing.assert_array_equal(after[kept_vertices], before[kept_vertices])
    np.testing.assert_allclose(after[held], before[held] - [0.4, 0, 0], atol=1e-3)
    scene.meshdeform.group = "Nose"
    with pytest.raises(RuntimeError, match="Nose"):
        bpy.ops.meshdeform.deform()


def test_undo_takes_it_back_and_redo_brings_it(scene: Any) -> None:
    target, suzanne = ball(), monkey()
    before = coordinates(suzanne.data.vertices)
    select(suzanne)
    towards(scene, target, "REPLACE")
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.meshdeform.deform("EXEC_DEFAULT", True) == {"FINISHED"}
    after = coordinates(bpy.data.objects["Suzanne"].data.vertices)
    assert np.abs(after - before).max() > 1e-3
    bpy.ops.ed.undo()  # one step, which the operator pushed
    np.testing.assert_array_equal(coordinates(bpy.data.objects["Suzanne"].data.vertices), before)
    bpy.ops.ed.redo()
    np.testing.assert_array_equal(coordinates(bpy.data.objects["Suzanne"].data.vertices), after)


def wait(found: Any) -> Any:
    deadline = time.monotonic() + 120
    while not (result := found()):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return result


def start(scene: Any) -> Any:
    from meshdeform_blender.session import current

    preferences = bpy.context.preferences.addons["meshdeform_blender"].preferences
    current.start(bpy.context.selected_objects, scene.meshdeform, preferences)
    return current


def test_polling_never_blocks_and_cancel_reaches_the_server(scene: Any, server: str) -> None:
    from meshdeform_blender.client import Client

    target, suzanne = ball(), monkey()
    before = coordinates(suzanne.data.vertices)
    select(suzanne)
    towards(scene, target, steps=50_000)
    current = start(scene)
    job = current.job
    assert not bpy.ops.meshdeform.deform.poll()  # one at a time

    def stepped() -> bool:
        assert current.poll() == "running"
        return job.status.step >= 1

    wait(stepped)
    assert 0.0 <= current.status.fraction < 1.0
    assert current.status.text.startswith("Step ")
    assert bpy.ops.meshdeform.cancel() == {"FINISHED"}
    assert (current.job, current.message, current.is_error) == (None, "Canceled.", False)
    assert bpy.ops.meshdeform.deform.poll()
    wait(lambda: Client(server).job(job.status.job_id)[0]["state"] == "canceled")
    np.testing.assert_array_equal(coordinates(suzanne.data.vertices), before)
    assert suzanne.data.shape_keys is None


def test_the_result_waits_for_object_mode_and_keeps_what_was_moved_meanwhile(scene: Any) -> None:
    target, suzanne = ball(), monkey()
    select(suzanne)
    towards(scene, target, "REPLACE")
    before = coordinates(suzanne.data.vertices)
    current = start(scene)
    bpy.ops.object.mode_set(mode="EDIT")
    wait(lambda: current.job.status.phase == "succeeded")
    assert current.poll() == "running"
    assert "Object Mode" in current.message
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0, 0, 4))
    bpy.ops.object.mode_set(mode="OBJECT")
    assert current.poll() == "applied"
    assert "was moved" in current.message
    lifted = coordinates(suzanne.data.vertices) - before
    assert abs(np.median(lifted[:, 2]) - 4) < 1.0
    assert np.abs(lifted - [0, 0, 4]).max() > 1e-3


def test_a_mesh_with_other_faces_by_then_is_left_alone(scene: Any) -> None:
    target, suzanne = ball(), monkey()
    select(suzanne)
    towards(scene, target)
    current = start(scene)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide()
    bpy.ops.object.mode_set(mode="OBJECT")
    count = len(suzanne.data.vertices)
    assert wait(lambda: (how := current.poll()) != "running" and how) == "failed"
    assert "were changed" in current.message
    assert "job_" in current.message
    assert (len(suzanne.data.vertices), suzanne.data.shape_keys) == (count, None)


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (lambda scene, obj: setattr(scene.meshdeform, "prompt", "a quixotic zeitgeist"), "zeitgeist"),
        (lambda scene, obj: setattr(scene.meshdeform, "guidance", "target"), "no target"),
        (lambda scene, obj: setattr(obj, "scale", (1, 1, 0)), "zero along an axis"),
        (lambda scene, obj: obj.data.clear_geometry(), "no faces"),
        (lambda scene, obj: setattr(_preferences(), "url", "http://127.0.0.1:1"), "does not answer"),
        (lambda scene, obj: setattr(_preferences(), "url", "https://example.com"), "may not use the network"),
    ],
)
def test_errors_are_reported(scene: Any, prepare: Any, words: str) -> None:
    suzanne = monkey()
    scene.meshdeform.prompt = "a mushroom"
    prepare(scene, suzanne)
    bpy.context.view_layer.update()
    select(suzanne)
    with pytest.raises(RuntimeError, match=words):  # what an operator reports as an error
        bpy.ops.meshdeform.deform()
    from meshdeform_blender.session import current

    assert words in current.message
    assert current.is_error


def _preferences() -> Any:
    return bpy.context.preferences.addons["meshdeform_blender"].preferences


class Layout:
    """A layout that resolves every property that a panel draws, as Blender does, and records the words."""

    def __init__(self, words: list[str]) -> None:
        self.words = words

    def prop(self, owner: Any, name: str, **options: Any) -> None:
        assert name in owner.bl_rna.properties
        self.words.append(name)

    def prop_search(self, owner: Any, name: str, data: Any, collection: str) -> None:
        assert collection in data.bl_rna.properties
        self.prop(owner, name)

    def operator(self, name: str, **options: Any) -> None:
        assert getattr(bpy.ops.meshdeform, name.partition(".")[2]).get_rna_type()
        self.words.append(name)

    def progress(self, *, factor: float, text: str) -> None:
        assert 0.0 <= factor <= 1.0
        self.words.append("progress")

    def label(self, *, text: str, icon: str) -> None:
        self.words.append(text)

    def row(self, **options: Any) -> Layout:
        return self

    column = box = row


def drawn(addon: Any) -> list[str]:
    view_layer, region = bpy.context.view_layer, SimpleNamespace(width=300)
    context = SimpleNamespace(scene=bpy.context.scene, region=region, view_layer=view_layer)
    layout = Layout([])
    addon.MESHDEFORM_PT_panel.draw(SimpleNamespace(layout=layout), context)
    return layout.words


def test_the_panel_and_the_timer_as_blender_calls_them(scene: Any) -> None:
    """Without a window there are no events, so call the methods as Blender would."""
    from meshdeform_blender import addon

    target, suzanne = ball(), monkey()
    select(suzanne)
    towards(scene, target)
    assert {"meshdeform.deform", "region", "symmetry", "handles"} <= set(drawn(addon))
    kind, reports = addon.MESHDEFORM_OT_deform, []
    operator = SimpleNamespace(report=lambda level, text: reports.append(text))
    operator._start = MethodType(kind._start, operator)
    operator._ended = MethodType(kind._ended, operator)
    manager = SimpleNamespace(
        windows=bpy.context.window_manager.windows,
        event_timer_add=lambda step, window: "timer",
        event_timer_remove=reports.append,
        modal_handler_add=lambda added: True,
    )
    context = SimpleNamespace(
        **{name: getattr(bpy.context, name) for name in ("scene", "view_layer", "selected_objects", "preferences")},
        window_manager=manager,
        window=None,
    )
    assert kind.invoke(operator, context, None) == {"RUNNING_MODAL"}
    assert {"progress", "meshdeform.cancel"} <= set(drawn(addon))
    assert kind.modal(operator, context, SimpleNamespace(type="MOUSEMOVE")) == {"PASS_THROUGH"}

    def ended() -> Any:
        outcome = kind.modal(operator, context, SimpleNamespace(type="TIMER"))
        return outcome if outcome != {"PASS_THROUGH"} else None

    assert wait(ended) == {"FINISHED"}
    assert reports == ["timer"]
    assert "Done." in drawn(addon)
    assert suzanne.data.shape_keys.key_blocks["Ball"].value == 1.0


def test_the_connection_can_be_tested(scene: Any) -> None:
    assert bpy.ops.meshdeform.check() == {"FINISHED"}
    _preferences().url = "http://127.0.0.1:1"
    with pytest.raises(RuntimeError, match="does not answer"):
        bpy.ops.meshdeform.check()


def test_the_add_on_leaves_nothing_behind(scene: Any) -> None:
    import addon_utils

    addon_utils.disable("meshdeform_blender", default_set=True)
    assert not hasattr(bpy.types.Scene, "meshdeform")
    assert "meshdeform_blender" not in bpy.context.preferences.addons
