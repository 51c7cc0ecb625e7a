"""Python packages with nodes, messages and manifests: which there are, and where their files are."""
