"""One step at a time: a simulator in the loop, its sensors, its cost, and its C sources and FMU."""
