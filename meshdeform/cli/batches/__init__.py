"""Many deformations at once: the rows of a manifest, what is known about them, and who does them."""
