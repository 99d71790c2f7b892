"""What the files say: URDF and YAML, checked and frozen; materials, sections, motions, controls."""
