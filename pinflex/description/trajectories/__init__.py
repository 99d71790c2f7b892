"""Motions that machines know: profiles by limits of speed, acceleration, jerk, and waypoints."""
