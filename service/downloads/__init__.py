"""Send stored files: the artifacts, checkpoints and input files of a job."""
