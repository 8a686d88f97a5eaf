"""Handle HTTP for all routes: bodies, API keys, errors, ranges, rate limits."""
