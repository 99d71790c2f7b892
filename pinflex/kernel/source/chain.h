/* A tree without loops, eliminated block by block (chain.c). */
#ifndef PINFLEX_CHAIN_H
#define PINFLEX_CHAIN_H

#include "stages.h"

/* chain_factors: for eigenvalue e, of M, C and K (nv, nv) and what blocks ask of each other (path.c),
   st->joined; 0 where a block is singular. chain_solve: x + iy in place, free rows. */
int chain_factors(const Tables *t, const Stages *st, Int e, const double *M);
void chain_solve(const Tables *t, const Stages *st, Int e, double *x, double *y);
/* M a + C v + K q, arrays (nv,); and room for 8 of them, free between solutions. */
void chain_product(const Tables *t, const Stages *st, const double *M, const double *a, const double *v,
                   const double *q, double *out);
double *chain_room(const Tables *t, const Stages *st);

#endif
