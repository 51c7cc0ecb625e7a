"""The format of the files, record by record: from bytes, to bytes, and where in a file what stands."""
