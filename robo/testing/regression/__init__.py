"""Regression by replay: the recorded inputs of nodes are fed to the nodes as they are now, and outputs are compared.

Each run is a process of its own, with nodes in lock step, as in other tests of nodes; `judge` looks at what they wrote.
"""
