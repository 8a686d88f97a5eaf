"""What the library makes, one folder for each kind of job."""
