"""Represent triangle meshes: connectivity, differential operators, welding, normals, quality."""

COLLAPSED_SHAPE = 1e-5
"""A face is collapsed if its area is at most this times its longest edge squared (an equilateral one has 0.433).

Along a needle of shape s, the weight of the energy is about s; across it, 1 / (4 s). Rounding errors of one direction
reach the other divided by 4 s^2, which leaves six digits at this threshold and none a hundredfold below it. The measure
is relative to the face itself, so it depends neither on the object's unit nor on the size of the face.
"""
