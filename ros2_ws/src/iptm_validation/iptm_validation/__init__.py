"""The models beside measured cars, cells and drivers: readers, fits, errors on held-out parts."""
