"""What roadside stations tell of the road, seen from the host: stop lines, their phases, and speed limits."""
