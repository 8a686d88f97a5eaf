"""Decode EXT_meshopt_compression and KHR_meshopt_compression in numpy, following the specifications.

`attributes` and `indices` decode the three bitstreams, `filters` applies the filters. `assets/compressed.py` finds what
is compressed.
"""
