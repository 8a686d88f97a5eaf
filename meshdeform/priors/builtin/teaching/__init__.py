"""Teach the builtin prior a noun from a user's own meshes: `meshdeform teach`.

The training continues from the weights in the package, or from taught ones, on pictures of the meshes' members and of
the nouns that the weights know already (replay), so that these are not forgotten.
"""
