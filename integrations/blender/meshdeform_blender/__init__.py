"""Meshdeform for Blender: deform the selected meshes by text, through a Meshdeform service.

Nothing here imports bpy before Blender calls `register`: `glb`, `client` and `job` can be used, and tested, without it.
"""

from __future__ import annotations


def register() -> None:
    """Register the add-on's classes with Blender."""
    from . import addon

    addon.register()


def unregister() -> None:
    """Unregister the add-on's classes."""
    from . import addon

    addon.unregister()
