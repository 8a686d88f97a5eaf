"""Build a release, and check its contents, dependencies and licences."""
