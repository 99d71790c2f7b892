"""Time integration: schemes, Newton, steps and their control."""
