"""A flexible link as stations on few coordinates: beams, modes, reduced solids."""
