"""Docker Compose: the file, its image, and what watches over containers."""
