"""Launch files, scenarios and the runner that drives, records and reports a closed loop."""
