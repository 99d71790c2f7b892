"""Published benchmarks as scenes built from a few numbers, for `pinflex verify`."""

from pinflex.lab import (
    arms,
    beams,
    elastica,
    flying,
    four_bars,
    loops,
    princeton,
    simeon,
    springs,
    tilted,
)
from pinflex.lab.record import Case

CASES: tuple[Case, ...] = (
    *beams.CASES,
    *loops.CASES,
    *four_bars.CASES,
    *springs.CASES,
    *simeon.CASES,
    *tilted.CASES,
    *flying.CASES,
    *arms.CASES,
    *elastica.CASES,
    *princeton.CASES,
)
