"""Reconstructions of few numbers: one lobe, several, the ABC model, the method of the thesis."""
