"""Plant, controller and meter as FMUs in C, and an FMU of others in the place of the plant."""
