"""Studies of how right a BRDF is."""
