"""Published benchmarks as scenes built from a few numbers, for `pinflex verify`."""

from pinflex.benchmarks import beams, elastica, loops
from pinflex.benchmarks.record import Case

CASES: tuple[Case, ...] = (*beams.CASES, *loops.CASES, *elastica.CASES)
