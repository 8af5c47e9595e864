"""A run's life: start, resume, stop rules, products."""
