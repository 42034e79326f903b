"""The road ahead from messages of roadside stations: stop lines, their phases, and speed limits."""
