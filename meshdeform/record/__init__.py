"""Jobs: what they are, the record that knows them, the queue that tells workers, the reconciler that mends both."""
