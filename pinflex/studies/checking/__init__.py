"""How pinflex reads a scene, and what looks wrong in it."""
