/* Real systems of equations, columns one after the other. */
#ifndef PINFLEX_LU_H
#define PINFLEX_LU_H

#include "lanes.h"

/* factors: in place, with pivots; 0 where the matrix is singular. solve: x in place. */
int factors(double *A, Int n, Int *pivot);
void solve(const double *A, Int n, const Int *pivot, double *x);

#endif
