/* Where a run of equal steps is, and what the next ones are given (alpha.c). */
#ifndef PINFLEX_ALPHA_H
#define PINFLEX_ALPHA_H

#include "law.h"

typedef struct {
  double *y;                           /* [nq] */
  double *v, *a, *s;                   /* [nv] */
  double *lam;                         /* [closures] */
} State;

typedef struct {
  Int most, stale;                     /* iterations of a step; whether it begins with a new tangent */
  Int iterations, refreshed;           /* counts */
  Int allowed, every, age;             /* tangents of a step, steps between them (0: as it takes); since the last */
  Int due, ready;                      /* whether a tangent is wanted; parts of it that are evaluated */
  Int fewest, wasted;                  /* iterations of a step with this tangent, less one (-1: not
                                          known), and of all its steps more than that */
  Int stopped;                         /* motor that the last step would have moved past its stop, or -1 */
  const Stages *joints;                /* of its lists alone */
  const Law *law;                      /* a feedback, or NULL */
  const double *predict;               /* [3, 4] a, and a, s, v before, to s, v and the move */
  State now, last, next;               /* of last: a and lam */
  Int curved;                          /* whether a, lam go on along a parabola, not a line; -1: a start */
  double *bend, *bend_lam;             /* [nv], [closures] how far the last ones were off their lines */
  double *move, *r;                    /* [nv] */
  double *open;                        /* [closures] */
  double *x, *room;                    /* [size] */
  double *tangent;                     /* [wide] M, C, K, J */
  double *lu, *narrow;                 /* [size, size] narrow: where entries lie near the diagonal */
  double *weight;                      /* [free] */
  double *motor_rows;                  /* [motors, free] */
  double *motor_J;                     /* [closures, motors] */
  Int *pivot;                          /* [size+1] */
  Int *order;                          /* [order] */
  Int band;                            /* of the unknowns in that order */
  const double *low, *high;            /* stops of the motors, (motors,), or NULL */
  double mass, by_v, by_y;             /* weights of M, C and K: da/ds, gamma h, beta h^2 */
  double tolerance, farthest;          /* m or rad that an elastic coordinate may go */
  double reference, peak;              /* accelerations: of the time, and the largest */
  double noise, rate, began, before, previous, ratio, second, usual;
} Alpha;

/* What is prescribed at the steps to come, and where they are recorded, row by row. */
typedef struct {
  const double *position, *velocity, *feed, *scale; /* feed: accelerations, or torques */
  double *y, *v, *a, *s, *lam, *torque, *power;
  double *u, *error;                                /* of a feedback */
} Rows;

/* Up to `count` steps; the number of those that were taken. */
Int pinflex_alpha(const Tables *t, char *memory, Alpha *m, Int count, const Rows *rows);

/* What the state and the torques of the motors change by as what the last step was given does, `by`
   (position and velocity of led motors, feed): dy and dv (nv,), torque (motors,). For now of m, whose
   factors are new ones then; 0: there are none. */
Int pinflex_alpha_slope(const Tables *t, char *memory, Alpha *m, const double *scale, const Rows *by,
                        double *dy, double *dv, double *torque);

#endif
