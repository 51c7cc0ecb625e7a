"""The node: what it declares, its topics, services, parameters, clock and log."""
