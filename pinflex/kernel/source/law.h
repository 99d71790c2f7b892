/* A continuous linear feedback: what it measures, drives, and how it goes on from step to step. */
#ifndef PINFLEX_LAW_H
#define PINFLEX_LAW_H

#include "stages.h"

typedef struct {
  Int measures, drives, states;
  const double *S;              /* [measures, nv] */
  const double *B;              /* [nv, drives] */
  const double *home;           /* [nq] */
  const double *target;         /* [measures] what errors are counted from */
  const double *x_of_x;         /* [states, states] */
  const double *x_of_e;         /* [states, measures] */
  const double *C;              /* [drives, states] */
  const double *D, *E;          /* [drives, measures] */
  double *x_before, *x;         /* [states] where the last step ended; at the state looked at last */
  double *e_before, *e, *rate;  /* [measures] */
  double *u;                    /* [drives] */
  double *way;                  /* [nv] from home */
} Law;

/* law.c: u at a state, r -= B u (where there is r); what it adds to C and K; power of what it drives;
   the end of a step */
void feed_back(const Tables *t, const Stages *st, const Law *law, const double *y, const double *v,
               double *r);
void feed_back_tangent(const Tables *t, const Law *law, double *C, double *K);
double law_power(const Tables *t, const Law *law, const double *v);
void end_step(const Law *law);

#endif
