"""Accept files ahead of the jobs that use them."""
