"""The mechanism as equations: expanded model, closures, loads, dynamics."""
