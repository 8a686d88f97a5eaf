"""Measure whether the noun of real assets is found that nothing here was made or tuned with."""
