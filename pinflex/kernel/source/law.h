/* A continuous linear feedback: what it measures, drives, and how it goes on from step to step. */
#ifndef PINFLEX_LAW_H
#define PINFLEX_LAW_H

#include "stages.h"

/* Rows and columns in turn: S (measures, nv), B (nv, drives); x_of_x, x_of_e, C, D and E by rows. */
typedef struct {
  Int measures, drives, states;
  const double *S, *B, *home, *target;
  const double *x_of_x, *x_of_e, *C, *D, *E;
  double *x_before, *e_before;  /* where the last step ended */
  double *x, *e, *rate, *u;     /* at the state that was looked at last */
  double *way;                  /* from home, (nv,) */
} Law;

/* law.c: u at a state, r -= B u (where there is r); what it adds to C and K; power of what it drives;
   the end of a step */
void feed_back(const Tables *t, const Stages *st, const Law *law, const double *y, const double *v,
               double *r);
void feed_back_tangent(const Tables *t, const Law *law, double *C, double *K);
double law_power(const Tables *t, const Law *law, const double *v);
void end_step(const Law *law);

#endif
