/* Newton's iteration in a step so far. */
#ifndef PINFLEX_NEWTON_H
#define PINFLEX_NEWTON_H

#include "stages.h"

enum { CONVERGED, FAILED, AGED };

typedef struct {
  Int iteration, most, fresh, placed, measured; /* fresh: iteration of the last tangent, or -1 */
  const Int *measured_at;                       /* velocity rows that count */
  const double *weight;                         /* (measured, measured) */
  double least, round_off, open;                /* goal over reach; least goal; of closures, m */
  double known;                                 /* rate of the first correction: 1 if nobody knows */
  double slack;                                 /* of these, where an iteration cannot go on */
  double scale, reach, goal, size, rate;        /* reach: largest displacement so far */
} Newton;

/* iterate.c. newton: goes on from `iteration`; after AGED that one waits for a new tangent at the
   placed stages. weighed: x' W x, x in the rows that count. reached: the largest displacement. */
int newton(const Tables *t, char *memory, const Stages *st, Newton *n);
double weighed(const Newton *n, const double *x);
double reached(const Tables *t, const Stages *st, const Newton *n);

#endif
