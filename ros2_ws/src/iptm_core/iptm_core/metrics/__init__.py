"""Results of a finished run: energy, degradation, spacing, temperatures and limits."""
