"""Train the builtin prior: generate shapes, render pictures and run the training loop."""
