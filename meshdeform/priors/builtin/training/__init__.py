"""Train the builtin prior: the shapes it learns from, their pictures, the training loop."""
