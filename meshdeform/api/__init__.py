"""Define the documents of the HTTP API, which the service writes and the client reads."""
