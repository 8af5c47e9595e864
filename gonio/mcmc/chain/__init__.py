"""What one round of Metropolis-Hastings is made of: chains, draws, steps, history."""
