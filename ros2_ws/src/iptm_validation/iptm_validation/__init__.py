"""The models compared with measured cars, cells and drivers: readers, fits, errors on held-out parts."""
