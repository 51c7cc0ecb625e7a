"""New recordings made of others: whole, or not there."""
