"""Messages to the webhooks of users: where they may go (`addresses`), how they go (`sender`), and when (`delivery`)."""
