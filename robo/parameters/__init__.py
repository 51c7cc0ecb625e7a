"""Parameters: values, annotations, words of a command line, files."""
