"""What every part may use: logs, traces, atomic files, failure points. Imports nothing of the package but `errors`."""
