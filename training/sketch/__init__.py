"""Train the network that guesses which noun a drawing shows: on lines of members, and on drawings by people."""
