"""Excerpts of public measurements; sources and licences stand in SOURCES.md."""
