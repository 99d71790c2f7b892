"""Result of a run, by name: arrays, views, comparison. No Pinocchio."""
