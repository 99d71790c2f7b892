/* The stages of a collocation step: the scheme, the run's own lists, and one step's arrays. */
#ifndef PINFLEX_STAGES_H
#define PINFLEX_STAGES_H

#include "kernel.h"

enum { MOST_STAGES = 9 }; /* 7 of a run, and two corrections */

/* Arrays with their shape in brackets, which Python reads there and makes; complex numbers are pairs.
   size = free + closures; room: see `StageKernel` in pinflex/integrators/compiled.py. */
typedef struct {
  Int s, values;                                     /* stages, eigenvalues of A^-1 kept */
  Int free, motors, prescribed;                      /* free rows; motors prescribed, or driven */
  Int plain, circles, balls, bodies;                 /* joints by how their coordinates move */
  const Int *free_at;                                /* [free] */
  const Int *motor_v, *motor_q, *motor_paired;       /* [motors] paired: q is a cosine, its sine behind it */
  const Int *plain_q, *plain_v;                      /* [plain] move by addition */
  const Int *circle_q, *circle_v;                    /* [circles] keep (cos, sin) */
  const Int *ball_q, *ball_v;                        /* [balls] */
  const Int *body_q, *body_v, *body_flat;            /* [bodies] free joints; flat: planar ones */
  const double *c;                                   /* [s] */
  const double *A, *A2, *A2_inverse;                 /* [s, s] */
  const double *value;                               /* [values, 2] */
  const double *forward;                             /* [values, s, 2] */
  const double *back;                                /* [s, values, 2] */
  const double *kp, *kd;                             /* [motors] gains of motors that are driven */
  double *held;                                      /* [nv] forces of a digital controller, or NULL */
  double *M, *C, *K;                                 /* [free, free] free rows and columns */
  double *J;                                         /* [closures, free] */
  const double *joined;                              /* of a chain in their place, see chain.h */
  double joined_h;                                   /* of its factors */
  double *lu;                                        /* [sets, size, size, 2, lanes] factors */
  double *part;                                      /* [part] right side, and room */
  Int *pivot;                                        /* [pivots] */
  double *y0;                                        /* [nq] the start */
  double *v0;                                        /* [nv] */
  double *position, *velocity, *feed;                /* [s, motors] */
  double *scale;                                     /* [s, forces] of loads */
  double *a, *turn;                                  /* [s, nv] unknowns, with lam */
  double *lam;                                       /* [s, closures] */
  double *y;                                         /* [s, nq] what follows from them */
  double *v, *move;                                  /* [s, nv] */
  double *torque;                                    /* [s, motors] before the last correction, as r, open */
  double *r, *change;                                /* [s, nv] residuals; what it changes of poses */
  double *open, *dlam;                               /* [s, closures] */
  double *da;                                        /* [s, free] the last correction, with dlam */
  double h;
} Stages;

/* Motors whose motion is prescribed: all or none. */
static inline Int led(const Stages *st) { return st->prescribed ? st->motors : 0; }

void pinflex_place(const Tables *t, const Stages *st);
void pinflex_balance(const Tables *t, char *memory, const Stages *st);
void pinflex_correct(const Tables *t, const Stages *st);

#endif
