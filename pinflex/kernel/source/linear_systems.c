/* Linear systems along a motion: entries of M, C, K and J at several states.

   Only free coordinates and motors are marched, so that few of the entries of a tangent are wanted:
   at: where these are in M, C, K (nv, nv) and J (closures, nv), one after the other. */
#include "kernel.h"

/* room: for one tangent; out (count, stride), of which the first `entries` of each row are written. */
EXPORT void pinflex_linear_systems(const Tables *t, char *memory, Int rates, Int count,
                                   const double *Y, const double *V, const double *A, const double *lam,
                                   const double *scale, Int entries, const Int *at, double *room,
                                   Int stride, double *out) {
  Int nv = t->nv, square = nv * nv;
  for (Int k = 0; k < count; k++) {
    pinflex_tangent(t, memory, rates, Y + k * t->nq, V + k * nv, A + k * nv, lam + k * t->closures,
                    scale + k * t->forces, room, room + square, room + 2 * square,
                    room + 3 * square);
    for (Int i = 0; i < entries; i++) out[k * stride + i] = room[at[i]];
  }
}
