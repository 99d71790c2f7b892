"""How a scene's text becomes values, and what is said where it cannot."""
