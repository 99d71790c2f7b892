/* The answer of a system of equations that may have many, as that of accelerations and multipliers
   does where coordinates have no mass: by LU where pivots say that there is one, else the least. */
#include "kernel.h"
#include "lu.h"

/* Pivots that differ by more show an answer that is not unique. */
static const double SINGULAR = 1e-11;

int regular(const double *lu, Int n) {
  double least = INFINITY, most = 0.0;
  for (Int k = 0; k < n; k++) {
    double x = fabs(lu[k * (n + 1)]);
    least = fmin(least, x), most = fmax(most, x);
  }
  return n == 0 || least > SINGULAR * most;
}

/* x (n,) of A (n, n) and b (n,), which are overwritten; room (n, n + 1), order (3 n,). */
EXPORT void pinflex_saddle(Int n, double *A, double *b, double *room, Int *order, double *x) {
  Int band = narrow_order(A, n, order, order + n), *pivot = order + n;
  for (Int i = 0; i < n; i++) x[i] = b[i];
  if (is_narrow(n, band)) {
    if (narrow_factors(A, n, order, band, room, pivot)
        && SINGULAR * narrow_spread(room, n, band) < 1.0) {
      narrow_solve(room, n, order, band, pivot, room + n * n, x);
      return;
    }
  } else {
    for (Int i = 0; i < n * n; i++) room[i] = A[i];
    if (factors(room, n, pivot) && regular(room, n)) {
      solve(room, n, pivot, x);
      return;
    }
  }
  least_norm(A, n, b, room, order, x);
}
