"""One call to a run: level, step or tolerance; going on."""
