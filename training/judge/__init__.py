"""Train and measure the judge."""
