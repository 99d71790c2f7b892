"""Design, tolerance, fit: derivatives of a scene, its best parameters, their scatter, and a fit."""
