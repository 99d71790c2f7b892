/* Where a run of equal steps is, and what the next ones are given (alpha.c). */
#ifndef PINFLEX_ALPHA_H
#define PINFLEX_ALPHA_H

#include "law.h"

/* A state: y (nq,), v, a and s (nv,), lam (closures,). */
typedef struct { double *y, *v, *a, *s, *lam; } State;

typedef struct {
  Int most, stale;                     /* iterations of a step; whether it begins with a new tangent */
  Int iterations, refreshed;           /* counts */
  Int allowed, every, age;             /* tangents of a step, steps between them (0: as it takes); since the last */
  Int due, ready;                      /* whether a tangent is wanted; whether one waits to be factored */
  Int fewest;                          /* iterations of a step with this tangent, less one; -1: not known */
  Int stopped;                         /* motor that the last step would have moved past its stop, or -1 */
  const Stages *joints;                /* of its lists alone */
  const Law *law;                      /* a feedback, or NULL */
  const double *predict;               /* (3, 4): a, and a, s, v before, to s, v and the move */
  State now, last, next;               /* of last: a and lam */
  double *move, *r, *open, *x;         /* (nv,), (nv,), (rows,), (n + rows,) */
  double *tangent, *lu, *weight, *motor_rows, *motor_J; /* M, C, K, J; (n,), (motors, n), (rows, motors) */
  double *narrow, *room;               /* factors where entries lie near the diagonal; (n + rows,) */
  Int *pivot, *order;                  /* order: (3 (n + rows),) */
  Int band;                            /* of the unknowns in that order */
  const double *low, *high;            /* stops of the motors, (motors,), or NULL */
  double mass, by_v, by_y;             /* weights of M, C and K: da/ds, gamma h, beta h^2 */
  double tolerance, farthest;          /* m or rad that an elastic coordinate may go */
  double reference, peak;              /* accelerations: of the time, and the largest */
  double noise, rate, began, previous, second, usual;
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
