"""Many runs of one scene: comparisons, sweeps, maps of poses, and the check of a model."""
