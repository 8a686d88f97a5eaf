"""Train and measure the models of Meshdeform. No part of the wheel: run it from a clone."""
