/* The stages of a collocation step: the scheme, the run's own lists, and one step's arrays. */
#ifndef PINFLEX_STAGES_H
#define PINFLEX_STAGES_H

#include "kernel.h"

enum { MOST_STAGES = 9 }; /* 7 of a run, and two corrections */

/* Arrays of stages are row by row, (s, .). */
typedef struct {
  Int s, values;                                     /* stages, eigenvalues of A^-1 kept */
  Int free, motors, prescribed;                      /* free rows; motors prescribed, or driven */
  Int plain, circles, balls, bodies;                 /* joints by how their coordinates move */
  const Int *free_at, *motor_v, *motor_q, *motor_paired;
  const Int *plain_q, *plain_v, *circle_q, *circle_v, *ball_q, *ball_v;
  const Int *body_q, *body_v, *body_flat;            /* free joints; flat: planar ones */
  const double *c, *A, *A2, *A2_inverse;             /* (s,), (s, s) */
  const double *value, *forward, *back;              /* complex: (values,), (values, s), (s, values) */
  const double *kp, *kd;                             /* gains of motors that are driven */
  double *held;                                      /* forces of a digital controller, or NULL */
  double *M, *C, *K, *J;                             /* free rows and columns, (n, n), (rows, n) */
  const double *joined;                              /* of a chain in their place, see chain.h */
  double joined_h;                                   /* of its factors */
  double *lu, *part;                                 /* complex factors and right side */
  Int *pivot;
  double *y0, *v0, *position, *velocity, *feed, *scale; /* the start, the motors, the loads */
  double *a, *lam, *turn;                            /* unknowns */
  double *y, *v, *move;                              /* what follows from them */
  double *torque, *r, *open;                         /* torques, residuals, closures before ... */
  double *da, *dlam, *change;                        /* ... the last correction */
  double h;
} Stages;

/* Motors whose motion is prescribed: all or none. */
static inline Int led(const Stages *st) { return st->prescribed ? st->motors : 0; }

void pinflex_place(const Tables *t, const Stages *st);
void pinflex_balance(const Tables *t, char *memory, const Stages *st);
void pinflex_correct(const Tables *t, const Stages *st);

#endif
