"""What is done with recorded bags: list, compare, export, replay, check, recover."""
