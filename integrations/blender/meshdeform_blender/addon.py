"""Define the add-on's Blender classes: preferences, the scene's settings, operators, the panel."""

# No `from __future__ import annotations` here: Blender reads the annotations of properties as objects.

import textwrap
import time
from typing import Any

import bpy

from .client import Client
from .errors import AddonError
from .session import HANDLE_START, current

_REDRAW_S = 0.2
# The numbers are those in scenes that were saved.
_PRESETS = [
    ("none", "By Shape", "Fitted to what the prompt stands for; towards an object, balanced", "NONE", 3),
    ("balanced", "Balanced", "Pushed by a model", "NONE", 0),
    ("preview", "Preview", "The same in fewer steps", "NONE", 1),
    ("paper", "Paper", "The published settings, 5,000 steps", "NONE", 2),
]
_GUIDANCE = [
    ("sds", "Prompt", "Deform towards the prompt"),
    ("target", "Object", "Deform towards the shape of another object"),
]
_FRONTS = [
    ("preset", "As the Preset", "The builtin model chooses the front; other models see +Z, Blender's -Y, as the front"),
    ("auto", "Automatic", "Found by what the asset is, if the model can tell"),
    ("keep", "-Y", "Blender's front view shows the front"),
    ("90", "+X", "The right view shows the front"),
    ("180", "+Y", "The back view shows the front"),
    ("270", "-X", "The left view shows the front"),
]
_REGIONS = [
    ("none", "None", "Everything may move"),
    ("keep", "Keep", "Whatever is in the vertex group does not move at all"),
    ("only", "Only", "Only what is in the vertex group moves"),
]
# Blender's axes: its Y is the file's Z, up to the sign.
_SYMMETRIES = [
    ("none", "None", "No symmetry is kept"),
    ("auto", "Automatic", "The symmetry that the meshes have, if any"),
    ("x", "X", "Left and right are mirror images"),
    ("z", "Y", "Front and back are mirror images"),
    ("y", "Z", "Top and bottom are mirror images"),
]
_APPLY = [
    ("SHAPE_KEY", "Shape Key", "Add the result as a shape key, so that a slider blends between source and result"),
    ("REPLACE", "Replace", "Move the vertices themselves, in all shape keys"),
]


class MESHDEFORM_preferences(bpy.types.AddonPreferences):
    """The address of the service and its API key."""

    bl_idname = __package__

    url: bpy.props.StringProperty(
        name="Server", default="http://127.0.0.1:8765", description="Address of the Meshdeform service"
    )
    api_key: bpy.props.StringProperty(
        name="API Key", subtype="PASSWORD", description="Empty if the service requires none"
    )

    def draw(self, context: Any) -> None:
        """Draw the preferences."""
        self.layout.prop(self, "url")
        self.layout.prop(self, "api_key")
        self.layout.operator("meshdeform.check")


class MESHDEFORM_settings(bpy.types.PropertyGroup):
    """The settings of the next deformation; saved with the scene."""

    guidance: bpy.props.EnumProperty(name="By", items=_GUIDANCE)
    prompt: bpy.props.StringProperty(name="Prompt", maxlen=1000, description="The new shape, in words")
    target: bpy.props.PointerProperty(
        name="Target", type=bpy.types.Object, poll=lambda _, obj: obj.type == "MESH", description="The target shape"
    )
    preset: bpy.props.EnumProperty(name="Preset", items=_PRESETS, default="none")
    steps: bpy.props.IntProperty(name="Steps", min=0, max=50_000, description="0: the preset's number")
    seed: bpy.props.IntProperty(
        name="Seed", min=0, description="The same seed gives the same result on the same server"
    )
    model: bpy.props.StringProperty(name="Model", maxlen=500, description="Empty: the server's default")
    front: bpy.props.EnumProperty(
        name="Front", items=_FRONTS, description="The side that becomes the front of what is in the prompt"
    )
    region: bpy.props.EnumProperty(name="Region", items=_REGIONS, description="Use of the vertex group")
    group: bpy.props.StringProperty(
        name="Vertex Group", maxlen=63, description="Faces count as in it if all their corners weigh more than 0.5"
    )
    handles: bpy.props.PointerProperty(
        name="Handles", type=bpy.types.Collection, description="The empties that take points of the surface along"
    )
    handle_weight: bpy.props.FloatProperty(
        name="Pull", default=1.0, min=0.01, max=1.0, description="1: the points are exactly where the empties are"
    )
    symmetry: bpy.props.EnumProperty(name="Symmetry", items=_SYMMETRIES)
    apply: bpy.props.EnumProperty(name="Result", items=_APPLY)

    def request(self) -> dict[str, Any]:
        """Return the request document."""
        params: dict[str, Any] = {"seed": self.seed, "guidance": {}}  # the server decides its kind
        if self.preset != "none":
            params["preset"] = self.preset
        if self.steps:
            params["steps"] = self.steps
        if self.model.strip() and self.guidance == "sds":
            params["guidance"]["model"] = self.model.strip()
        if self.front != "preset" and self.guidance == "sds":
            params["guidance"]["orientation"] = float(self.front) if self.front.isdigit() else self.front
        prompt = self.prompt.strip() if self.guidance == "sds" else ""
        return {"prompt": prompt, "params": params, "metadata": {"from": "blender"}}


class MESHDEFORM_OT_deform(bpy.types.Operator):
    """Send the selected meshes to the service and apply the result. Blender stays usable meanwhile"""

    bl_idname = "meshdeform.deform"
    bl_label = "Deform"
    bl_options = {"UNDO"}  # noqa: RUF012 - Blender's own form; not REGISTER, whose panel would run the job again

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether a mesh is selected and no job is running."""
        return (
            current.job is None
            and context.mode == "OBJECT"
            and any(obj.type == "MESH" for obj in context.selected_objects)
        )

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Start from the panel, and poll with a timer."""
        if not self._start(context):
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(_REDRAW_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Let every event through; poll the job on each timer tick."""
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        _redraw(context)
        outcome = current.poll()
        if outcome == "running":
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        return self._ended(outcome)

    def execute(self, context: Any) -> set[str]:
        """Start from a script, and wait for the result."""
        if not self._start(context):
            return {"CANCELLED"}
        while (outcome := current.poll()) == "running":
            time.sleep(0.05)
        return self._ended(outcome)

    def cancel(self, context: Any) -> None:
        """Cancel the job when Blender closes the window or loads another file."""
        current.cancel()

    def _start(self, context: Any) -> bool:
        active = context.view_layer.objects.active
        objects = sorted(context.selected_objects, key=lambda obj: obj != active)
        try:
            current.start(objects, context.scene.meshdeform, context.preferences.addons[__package__].preferences)
        except AddonError as error:
            current.message, current.is_error = error.text, True
            self.report({"ERROR"}, error.text)
            return False
        return True

    def _ended(self, outcome: str) -> set[str]:
        if outcome == "failed":
            self.report({"ERROR"}, current.message)
        elif current.message != "Done.":
            self.report({"INFO"}, current.message)
        return {"FINISHED"} if outcome == "applied" else {"CANCELLED"}


class MESHDEFORM_OT_add_handle(bpy.types.Operator):
    """Add an empty at the 3D cursor. Move it: the nearest point of the surface goes with it in the next deformation"""

    bl_idname = "meshdeform.add_handle"
    bl_label = "Add Handle"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's own form

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether objects can be added."""
        return bool(context.mode == "OBJECT")

    def execute(self, context: Any) -> set[str]:
        """Add the empty to the collection of handles, which is made if there is none."""
        settings = context.scene.meshdeform
        if settings.handles is None:
            settings.handles = bpy.data.collections.new("Meshdeform Handles")
            context.scene.collection.children.link(settings.handles)
        empty = bpy.data.objects.new("Handle", None)
        empty.empty_display_type, empty.empty_display_size = "SPHERE", 0.1
        empty.location = context.scene.cursor.location
        empty[HANDLE_START] = list(context.scene.cursor.location)
        settings.handles.objects.link(empty)
        return {"FINISHED"}


class MESHDEFORM_OT_cancel(bpy.types.Operator):
    """Stop the running deformation"""

    bl_idname = "meshdeform.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Return whether a job is running."""
        return current.job is not None

    def execute(self, context: Any) -> set[str]:
        """Cancel the job."""
        current.cancel()
        return {"FINISHED"}


class MESHDEFORM_OT_check(bpy.types.Operator):
    """Check that the service answers and accepts the key"""

    bl_idname = "meshdeform.check"
    bl_label = "Test Connection"

    def execute(self, context: Any) -> set[str]:
        """Report the service's version, or why it cannot be used."""
        preferences = context.preferences.addons[__package__].preferences
        try:
            version = Client(preferences.url, preferences.api_key, timeout_s=5.0, tries=1).version()
        except AddonError as error:
            self.report({"ERROR"}, error.text)
            return {"CANCELLED"}
        self.report({"INFO"}, f"Meshdeform {version} answers.")
        return {"FINISHED"}


class MESHDEFORM_PT_panel(bpy.types.Panel):
    """The add-on's tab in the sidebar."""

    bl_label = "Meshdeform"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Meshdeform"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        settings, layout = context.scene.meshdeform, self.layout
        layout.use_property_split = True
        layout.prop(settings, "guidance", expand=True)
        if settings.guidance == "target":
            layout.prop(settings, "target")
        else:
            layout.prop(settings, "prompt")
            layout.prop(settings, "model")
            layout.prop(settings, "front")
        for name in ("preset", "steps", "seed", "apply"):
            layout.prop(settings, name)
        _draw_control(layout, context, settings)
        status = current.status
        if status is not None:
            row = layout.row()
            row.progress(factor=status.fraction, text=status.text)
            row.operator("meshdeform.cancel", text="", icon="X")
        else:
            layout.operator("meshdeform.deform", icon="MOD_SIMPLEDEFORM")
        if current.message:
            box = layout.box().column(align=True)
            for number, line in enumerate(textwrap.wrap(current.message, max(20, context.region.width // 9))):
                icon = "NONE" if number else ("ERROR" if current.is_error else "INFO")
                box.label(text=line, icon=icon)


def _draw_control(layout: Any, context: Any, settings: Any) -> None:
    """Draw what says where the meshes may deform."""
    column = layout.column(heading="Control")
    column.prop(settings, "region")
    active = context.view_layer.objects.active
    if settings.region != "none":
        if active is not None and active.type == "MESH":
            column.prop_search(settings, "group", active, "vertex_groups")
        else:
            column.prop(settings, "group")
    column.prop(settings, "symmetry")
    column.prop(settings, "handles")
    if settings.handles is not None:
        column.prop(settings, "handle_weight")
    column.operator("meshdeform.add_handle", icon="EMPTY_DATA")


_CLASSES = (
    MESHDEFORM_preferences,
    MESHDEFORM_settings,
    MESHDEFORM_OT_deform,
    MESHDEFORM_OT_add_handle,
    MESHDEFORM_OT_cancel,
    MESHDEFORM_OT_check,
    MESHDEFORM_PT_panel,
)


def register() -> None:
    """Register all classes and the scene's settings."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.meshdeform = bpy.props.PointerProperty(type=MESHDEFORM_settings)


def unregister() -> None:
    """Cancel a running job and unregister everything."""
    current.cancel()
    del bpy.types.Scene.meshdeform
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)


def _redraw(context: Any) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
