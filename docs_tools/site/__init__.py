"""Makes the site of the pages, `python -m docs_tools.site`, and its pictures, `python -m docs_tools.site.images`."""
