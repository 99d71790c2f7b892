"""What a run leaves behind, by name: arrays, views, comparison. No Pinocchio."""
