"""The levels of the theory, rigid to coupled, and linear vibration."""
