"""Train the network that reads line drawings."""
