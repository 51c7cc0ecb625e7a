"""A manifest as objects of Kubernetes."""
