"""BRDFs by formula."""
