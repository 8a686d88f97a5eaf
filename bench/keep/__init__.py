"""What people get from a noun: whole jobs on real assets, graded by eye without knowing which code made them."""
