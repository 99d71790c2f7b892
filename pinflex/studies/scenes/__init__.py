"""A scene proposed for a robot that has none."""
