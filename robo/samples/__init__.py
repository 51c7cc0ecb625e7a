"""Messages as an outsider sees them: with the time of their arrival, of any type."""
