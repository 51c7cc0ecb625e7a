"""What servers of pages and of viewers have in common: who is let in, where they are, their sockets."""
