"""What nodes say now beside what they said in a recording."""
