"""Strings of vehicles, each following the one ahead: drive, record, report."""
