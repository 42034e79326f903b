"""Years of use: trips, charging and parking in a climate, and the capacity that they cost."""
