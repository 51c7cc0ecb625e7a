"""What makes the documentation: reference pages from the code, pictures from real runs, a site from the pages."""
