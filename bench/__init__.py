"""Measure the product, and compare it with others. No part of the wheel: run it from a clone."""
