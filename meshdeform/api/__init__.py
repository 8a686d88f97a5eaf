"""The documents of the HTTP API that the service writes and the client reads."""
