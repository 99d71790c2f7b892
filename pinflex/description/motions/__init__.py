"""Laws of motion, what shapes them, and sampled trajectories."""
