"""Further kinds of job, one folder for each."""
