"""Fit an asset to what a noun stands for, part to part. numpy, scipy and numba alone."""
