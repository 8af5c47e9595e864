"""BRDFs by numbers: measured tables and networks."""
