"""The figures of the 2024 thesis, 5.1 to 5.9 and 6.1 to 6.7, on a run's data: `gonio report RUN --figures thesis`."""
