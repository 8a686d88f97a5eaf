"""Kinds of job. Each has a torch-free check at the door and a run in the worker."""
