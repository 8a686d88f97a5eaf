"""Send messages to users' webhooks: allowed addresses (`addresses`), sending (`sender`) and scheduling (`delivery`)."""
