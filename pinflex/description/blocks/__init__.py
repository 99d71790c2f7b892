"""The blocks of a scene file, a frozen record each."""
