"""Published benchmarks as scenes built from a few numbers, for `pinflex verify`."""

from pinflex.benchmarks import beams, elastica, four_bars, loops, princeton, springs
from pinflex.benchmarks.record import Case

CASES: tuple[Case, ...] = (
    *beams.CASES,
    *loops.CASES,
    *four_bars.CASES,
    *springs.CASES,
    *elastica.CASES,
    *princeton.CASES,
)
