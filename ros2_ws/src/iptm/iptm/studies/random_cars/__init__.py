"""A campaign of random legal cars, climates, cycles and grids, and what must hold in every run of it."""
