"""Jobs: accept, read, list, cancel and delete them."""
