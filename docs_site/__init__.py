"""What makes the site of the pages, and its pictures: `python -m docs_site`, `python -m docs_site.images`."""
