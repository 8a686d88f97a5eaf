"""Meshdeform: deform 3D assets by text, and give the asset back whole.

This package imports nothing heavy: ``import meshdeform`` needs neither torch nor a web framework.
The numerical core lives in modules that are imported by name, e.g. ``meshdeform.deform``.
"""

__all__ = ["__version__"]

__version__ = "0.1.0"
