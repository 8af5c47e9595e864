"""Which device is on which port."""
