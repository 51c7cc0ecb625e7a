"""Message types as people and other systems describe them."""
