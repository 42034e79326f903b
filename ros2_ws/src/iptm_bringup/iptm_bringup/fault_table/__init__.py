"""The table of faults: what happens, what is said, how long until normal; made by one command."""
