"""From counts to f and its sigma."""
