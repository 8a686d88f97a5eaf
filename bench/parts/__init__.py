"""The suite `parts`: what the product finds on public assets, against the parts that one would name on them."""
