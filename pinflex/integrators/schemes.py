"""The alpha family: one-step schemes for M a + ... = 0 as four coefficients.

    (1 - alpha_m) s1 + alpha_m s0 = (1 - alpha_f) a1 + alpha_f a0
    y1 = y0 + h v0 + h^2 ((1/2 - beta) s0 + beta s1),     v1 = v0 + h ((1 - gamma) s0 + gamma s1)

s is the algorithmic acceleration; a is the true one, which satisfies the equations at the new time,
so that torques and multipliers keep second order (Arnold and Bruels 2007, eqs. 8 to 10).
"""

from __future__ import annotations

from dataclasses import dataclass

from pinflex.boundary import public
from pinflex.errors import DescriptionError, nearest


@dataclass(frozen=True)
class AlphaScheme:
    """Coefficients of one member of the family.

    Attributes:
        name: For reports.
        alpha_m, alpha_f: Averages of inertia and of the other forces.
        beta, gamma: Newmark's coefficients.
    """

    name: str
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float

    @property
    def order(self) -> int:
        """Power of the step that errors fall with: 2, or 1 where gamma damps by itself."""
        return 2 if abs(self.gamma - 0.5 - self.alpha_f + self.alpha_m) < 1e-9 else 1

    @property
    def mass_factor(self) -> float:
        """da/ds of the new step."""
        return (1.0 - self.alpha_m) / (1.0 - self.alpha_f)

    def weights(self, h: float) -> tuple[float, float, float]:
        """Of M, C and K in the matrix of a step of h (s): what ds adds to a, v and y."""
        return self.mass_factor, self.gamma * h, self.beta * h * h


@public
def generalized_alpha(rho_inf: float = 0.8) -> AlphaScheme:
    """Second order, spectral radius rho_inf at infinite frequency (Chung and Hulbert 1993).

    Args:
        rho_inf: 0 (annihilates what the step cannot resolve) to 1 (keeps it).
    """
    if not 0.0 <= rho_inf <= 1.0:
        raise DescriptionError(f"solve.rho_inf: {rho_inf} is outside [0, 1]. Usual: 0.5 to 0.9.")
    alpha_m = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0)
    alpha_f = rho_inf / (rho_inf + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    return AlphaScheme("generalized_alpha", alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma)


@public
def hht(rho_inf: float = 0.8) -> AlphaScheme:
    """Hilber, Hughes and Taylor 1977 with alpha = (1 - rho_inf)/(1 + rho_inf), at most 1/3."""
    alpha = (1.0 - rho_inf) / (1.0 + rho_inf)
    if not 0.0 <= alpha <= 1.0 / 3.0 + 1e-12:
        raise DescriptionError(
            f"solve.rho_inf: {rho_inf} is outside [0.5, 1], where HHT is second order and stable."
        )
    return AlphaScheme("hht", 0.0, alpha, 0.25 * (1.0 + alpha) ** 2, 0.5 + alpha)


@public
def newmark(gamma: float = 0.5, beta: float = 0.25) -> AlphaScheme:
    """Newmark 1959: gamma = 1/2, beta = 1/4 is the average-acceleration (trapezoidal) rule.

    Args:
        gamma: Weight of the new acceleration in the speed [-].
        beta: The same in the position [-].
    """
    if gamma < 0.5 or beta < 0.25 * (gamma + 0.5) ** 2 - 1e-12:
        raise DescriptionError(
            f"solve.newmark: [{gamma}, {beta}] is not unconditionally stable. "
            "Take gamma >= 1/2 and beta >= (gamma + 1/2)^2 / 4."
        )
    return AlphaScheme("newmark", 0.0, 0.0, beta, gamma)


def scheme(
    name: str, rho_inf: float = 0.8, coefficients: tuple[float, float] | None = None
) -> AlphaScheme:
    """A scheme by name, as `solve.integrator` of the YAML says it."""
    if name == "newmark":
        return newmark(*coefficients) if coefficients is not None else newmark()
    if name in ("generalized_alpha", "hht"):
        return generalized_alpha(rho_inf) if name == "generalized_alpha" else hht(rho_inf)
    names = ("generalized_alpha", "hht", "newmark")
    raise DescriptionError(f"solve.integrator: {name}.{nearest(name, names)}")
