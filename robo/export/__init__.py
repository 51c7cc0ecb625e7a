"""A plan in the forms of other systems that run processes."""
