"""Compute the guidance loss on rendered views: `base.Guidance` is the interface, `sds` and `target` implement it."""
