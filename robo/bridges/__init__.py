"""Other systems, by their own protocols."""
