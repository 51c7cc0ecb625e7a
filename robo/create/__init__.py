"""New packages, and new nodes and messages in one that is there: from what is asked to the text of files."""
