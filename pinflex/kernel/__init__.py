"""The equations compiled: plain C behind ctypes, for every system that it covers."""
