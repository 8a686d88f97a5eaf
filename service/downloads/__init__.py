"""Send stored files: artifacts, checkpoints, and the files that a job was made of."""
