"""The levels of the theory, rigid to coupled, their steps in time, and linear vibration."""
