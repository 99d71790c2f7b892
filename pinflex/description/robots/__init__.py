"""Robots from URDF, xacro, SDF, MJCF and example-robot-data."""
