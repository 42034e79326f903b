"""Tools for recorded bags: list, compare, export, replay, check, recover."""
