"""Provide logs, traces, atomic files and failpoints to all other folders. Imports only `errors` of the package."""
