"""A live view of a run: a page in the browser, a Foxglove server, and layouts for other viewers."""
