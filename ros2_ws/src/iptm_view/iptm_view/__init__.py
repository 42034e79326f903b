"""A live view of a run: a page of our own in the browser, a Foxglove server, and layouts for other viewers."""
