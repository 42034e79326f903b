"""Identification of what the paper omits: trip and parameters, fitted to its strategy table alone."""
