"""Plain data and words: trees with positions, files, tables, drawings, suggestions. No network."""
