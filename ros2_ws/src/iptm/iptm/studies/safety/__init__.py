"""Safety trials: leads that brake, disturbed measurements and previews, delays, and undisturbed driving."""
