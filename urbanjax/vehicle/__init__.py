"""Vehicle models, limits and car following."""
