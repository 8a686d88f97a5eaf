"""Provide logs, traces, atomic files and failpoints to all parts. Imports only `errors` of the package."""
