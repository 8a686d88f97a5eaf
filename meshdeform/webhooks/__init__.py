"""Send messages to users' webhooks: sending (`sender`) and scheduling (`delivery`)."""
