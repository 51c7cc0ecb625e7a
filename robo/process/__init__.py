"""The programs that run as processes: a node, a router, the template, a look at a node's health."""
