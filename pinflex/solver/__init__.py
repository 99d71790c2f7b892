"""One call to a result: the level, its step or tolerance, going on, and advice on them."""
