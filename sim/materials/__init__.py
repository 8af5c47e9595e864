"""Small fits of real materials, for where the measured tables are not at hand. Data; `fit.py` made them."""
