"""What every route needs of HTTP: bodies, keys, errors, ranges, limits on rates."""
