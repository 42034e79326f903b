"""Fits of the models and their errors, one data set and quantity per file."""
