"""Thin shell over meshdeform."""
