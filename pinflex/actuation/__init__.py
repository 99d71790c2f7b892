"""What moves the mechanism: motors, the nominal motion, prescribed or controlled torques."""
