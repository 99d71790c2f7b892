/* Real systems of equations, columns one after the other. */
#ifndef PINFLEX_LU_H
#define PINFLEX_LU_H

#include "lanes.h"

/* factors: in place, with pivots; 0 where the matrix is singular. solve: x in place. */
int factors(double *A, Int n, Int *pivot);
void solve(const double *A, Int n, const Int *pivot, double *x);
/* narrow.c: order (n,) of the unknowns, room (2 n,), and how far entries are then from the diagonal;
   is_narrow: whether a band that wide pays. narrow_factors: of A (n, n), as it is, into B (n, 3 band + 1), with
   pivots; 0 where it is singular. narrow_spread: largest over smallest pivot. narrow_solve: x in place,
   room (n,). */
Int narrow_order(const double *A, Int n, Int *order, Int *room);
int is_narrow(Int n, Int band);
int narrow_factors(const double *A, Int n, const Int *order, Int band, double *B, Int *pivot);
double narrow_spread(const double *B, Int n, Int band);
void narrow_solve(const double *B, Int n, const Int *order, Int band, const Int *pivot, double *room,
                  double *x);

/* least_norm.c: x (n,) of A (n, n) and b (n,), which are overwritten; room (n, n + 1), order (2 n,) */
void least_norm(double *A, Int n, double *b, double *room, Int *order, double *x);

/* saddle.c: whether the pivots of factors (n, n) say that the answer is unique; x likewise, by LU
   where they do; order (3 n,) */
int regular(const double *lu, Int n);
void pinflex_saddle(Int n, double *A, double *b, double *room, Int *order, double *x);

#endif
