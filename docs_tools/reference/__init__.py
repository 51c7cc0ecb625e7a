"""Writes `docs/reference/` from the code, for developers; no part of the wheel: `python -m docs_tools.reference`.

Each page is a function from nothing to Markdown. What a page says stands in the code, with what it is about; a thing
without a description is a `Gap`, and no page is made.
"""
