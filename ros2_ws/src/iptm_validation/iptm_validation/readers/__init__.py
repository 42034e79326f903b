"""Readers of public measurements, as they are downloaded and in the compact form of the excerpts."""
