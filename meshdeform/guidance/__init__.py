"""What pulls the mesh: `base.Guidance` is the interface, `sds` and `target` are the kinds."""
