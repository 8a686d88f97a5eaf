"""Connect to hosts that users name, for messages to webhooks and files to fetch. Imports only `errors`."""
