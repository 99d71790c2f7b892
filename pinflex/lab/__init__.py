"""Published and exact benchmarks that `pinflex verify` measures."""
