"""EXT_meshopt_compression and KHR_meshopt_compression: a decoder in numpy, written from the specifications.

`attributes` and `indices` hold the three bitstreams, `filters` what is applied after them, `views` the buffer views.
"""
