/* States row by row into the lanes of a workspace, a group at a time, and back (residual.c). */
#ifndef PINFLEX_GROUP_H
#define PINFLEX_GROUP_H

#include "kernel.h"

typedef struct { Lane *y, *v, *a, *lam, *scale, *r, *c, *open, *wrench; double *more; } Group;

void lay_out(const Tables *t, char *memory, Work *w, Group *g);

/* Rows of (count, width) from `first` on into lanes, past the end the last row again; and back. */
void gather(const double *from, Int count, Int width, Int first, Lane *to);
void scatter(const Lane *from, Int count, Int width, Int first, double *to);

/* The nodes at rest at poses Y (count, nq) from `first` on. */
void stand(const Tables *t, Work *w, Group *g, const double *Y, Int count, Int first);

#endif
