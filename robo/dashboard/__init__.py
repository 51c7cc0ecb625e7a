"""The page in a browser: what a robot says, shown; and driving it, by one person at a time."""
