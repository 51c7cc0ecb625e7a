"""What two processes must agree on: names, keys, reports, encoding, and how they join the network."""
