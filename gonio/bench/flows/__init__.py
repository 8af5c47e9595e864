"""Studies of the normalizing flow, and the training of those that ship."""
