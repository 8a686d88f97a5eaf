"""Describe the routes: the HTML reference, the links between operations, the documented answers."""
