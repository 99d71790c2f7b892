"""The commands of the command line; pinflex/__main__.py reads their arguments."""
