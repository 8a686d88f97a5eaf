"""Whole shapes, deformed as attributes say."""
