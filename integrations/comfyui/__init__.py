"""Deform 3D assets by text in ComfyUI, through a Meshdeform service. Loads neither torch nor anything of ComfyUI's."""

from .nodes import NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS

__all__ = ["NODE_CLASS_MAPPINGS", "NODE_DISPLAY_NAME_MAPPINGS"]
