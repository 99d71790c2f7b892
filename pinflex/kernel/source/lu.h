/* Real systems of equations, columns one after the other. */
#ifndef PINFLEX_LU_H
#define PINFLEX_LU_H

#include "lanes.h"

/* factors: in place, with pivots; 0 where the matrix is singular. solve: x in place. */
int factors(double *A, Int n, Int *pivot);
void solve(const double *A, Int n, const Int *pivot, double *x);
/* least_norm.c: x (n,) of A (n, n) and b (n,), which are overwritten; room (n, n + 1), order (2 n,) */
void least_norm(double *A, Int n, double *b, double *room, Int *order, double *x);

#endif
