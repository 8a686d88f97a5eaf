"""Guidance: what pulls the mesh. One interface (`base`); score distillation (`sds`); a target mesh (`target`)."""
