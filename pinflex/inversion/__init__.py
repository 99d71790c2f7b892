"""Motor motions that make the platform, not the motors, follow a path; linear models; shapers."""
