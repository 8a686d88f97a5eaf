"""Provide what every part may use: logs, traces, atomic files, failpoints. Imports only `errors` of the package."""
