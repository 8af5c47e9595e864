"""Normalizing flows on the unit cube of pairs of directions. NumPy asks them, torch (`train.py` alone) trains them."""
