"""From states to named quantities: poses, forces, stresses, validity."""
