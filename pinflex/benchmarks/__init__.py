"""Published benchmarks as scenes built from a few numbers, for `pinflex verify`."""
