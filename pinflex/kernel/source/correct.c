/* Steps of a run corrected one after the other by a scheme of more stages.

   Each starts where the corrected step before it ended, dy and dv away from where the run's own
   step did. Its stages answer to that by the tangent,

     [ mu^2 M + h mu C + h^2 K    J' ] [  dz  ]     [ K (dy + h c dv) + C dv ]
     [ J                          0  ] [ -dlam] = - [ J (dy + h c dv) / h^2  ]

   and one or two corrections by their own residuals follow. */
#include <string.h>

#include "stages.h"

/* Field by field that of pinflex/kernel/corrections.py. Arrays are (steps, .) and (steps, s, .). */
typedef struct {
  Int count, factored;                             /* steps; whether factors are of the first one */
  const Int *tangent, *times;                      /* which tangent; corrections to make */
  const double *h;                                 /* s */
  double *M, *C, *K, *J;                           /* tangents, (tangents, n, n), (tangents, rows, n) */
  double *run_y, *run_v;                           /* where the run's steps start */
  double *position, *velocity, *scale;             /* of motors and loads at the stages */
  double *y, *v;                                   /* starts, and the last end: (steps + 1, .) */
  double *a, *lam, *turn;                          /* a guess, then the stages */
  double *move, *stage_v, *r, *da, *dlam, *change; /* of the last correction */
} Corrections;

void pinflex_residuals(const Tables *t, char *memory, Int count, const double *Y, const double *V,
                       const double *A, const double *lam, const double *scale, double *R,
                       double *C);
void pinflex_place(const Tables *t, const Stages *st);
void pinflex_correct(const Tables *t, const Stages *st);
void pinflex_solve(const Tables *t, const Stages *st);
int pinflex_factor(const Tables *t, const Stages *st);

static void take(double *to, const double *from, Int n) { memcpy(to, from, n * sizeof(double)); }

/* The shorter rotation vector of conj(q0) q1, scalars last. */
static void ball_between(const double *q0, const double *q1, double *out) {
  double x = -q0[0], y = -q0[1], z = -q0[2], w = q0[3];
  double p[3] = {w * q1[0] + x * q1[3] + y * q1[2] - z * q1[1],
                 w * q1[1] - x * q1[2] + y * q1[3] + z * q1[0],
                 w * q1[2] + x * q1[1] - y * q1[0] + z * q1[3]};
  double c = w * q1[3] - x * q1[0] - y * q1[1] - z * q1[2], sign = c < 0.0 ? -1.0 : 1.0;
  double sine = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
  double k = sine < 1e-150 ? 2.0 : 2.0 * atan2(sine, sign * c) / sine;
  for (Int d = 0; d < 3; d++) out[d] = sign * k * p[d];
}

/* The move that takes y0 to y1; rows of motors mean nothing. */
static void between(const Tables *t, const Stages *st, const double *y0, const double *y1,
                    double *move) {
  for (Int k = 0; k < st->plain; k++)
    move[st->plain_v[k]] = y1[st->plain_q[k]] - y0[st->plain_q[k]];
  for (Int k = 0; k < st->circles; k++) {
    const double *p = y0 + st->circle_q[k], *q = y1 + st->circle_q[k];
    move[st->circle_v[k]] = atan2(p[0] * q[1] - p[1] * q[0], p[0] * q[0] + p[1] * q[1]);
  }
  for (Int k = 0; k < st->balls; k++)
    ball_between(y0 + st->ball_q[k], y1 + st->ball_q[k], move + st->ball_v[k]);
  for (Int i = 0; i < t->nv - t->nv_rigid; i++)
    move[t->nv_rigid + i] = y1[t->nq_rigid + i] - y0[t->nq_rigid + i];
}

/* Answer of the stages to a start that is dy and dv away, by the tangent alone. */
static void follow(const Tables *t, const Stages *st, const double *dy, const double *dv) {
  Int n = st->free, rows = t->closures, s = st->s, nv = t->nv;
  for (Int k = 0; k < s; k++) {
    double way = st->h * st->c[k];
    for (Int i = 0; i < n; i++) {
      double sum = 0.0;
      for (Int j = 0; j < n; j++) {
        Int at = st->free_at[j];
        sum += st->K[i * n + j] * (dy[at] + way * dv[at]) + st->C[i * n + j] * dv[at];
      }
      st->r[k * nv + st->free_at[i]] = sum;
    }
    for (Int i = 0; i < rows; i++) {
      double sum = 0.0;
      for (Int j = 0; j < n; j++) {
        Int at = st->free_at[j];
        sum += st->J[i * n + j] * (dy[at] + way * dv[at]);
      }
      st->open[k * rows + i] = sum;
    }
  }
  pinflex_correct(t, st); /* a and lam go along */
}

/* Step `k` into the stages. */
static void take_step(const Tables *t, Stages *st, const Corrections *x, Int k) {
  Int s = st->s, nv = t->nv, n = st->free, at = k * s;
  Int square = x->tangent[k] * n * n, wide = x->tangent[k] * t->closures * n;
  st->h = x->h[k];
  st->M = x->M + square, st->C = x->C + square, st->K = x->K + square, st->J = x->J + wide;
  st->y0 = x->y + k * t->nq, st->v0 = x->v + k * nv;
  st->position = x->position + at * st->motors, st->velocity = x->velocity + at * st->motors;
  st->scale = x->scale + at * t->forces;
  st->a = x->a + at * nv, st->lam = x->lam + at * t->closures, st->turn = x->turn + at * nv;
  st->move = x->move + at * nv, st->v = x->stage_v + at * nv, st->r = x->r + at * nv;
  st->da = x->da + at * n, st->dlam = x->dlam + at * t->closures;
}

/* Corrects all steps; the number of those whose equations are not singular. */
EXPORT Int pinflex_correct_steps(const Tables *t, char *memory, const Stages *given,
                                 const Corrections *x) {
  Stages here = *given, *st = &here;
  Int s = st->s, nv = t->nv, nq = t->nq;
  double *dy = st->v, *dv = st->v + nv; /* those of `given`, which are free */
  for (Int k = 0; k < x->count; k++) {
    const double *y0 = x->run_y + k * nq, *v0 = x->run_v + k * nv;
    take_step(t, st, x, k);
    int known = k ? x->tangent[k] == x->tangent[k - 1] && x->h[k] == x->h[k - 1] : x->factored;
    if (!known && !pinflex_factor(t, st)) return k;
    between(t, st, y0, st->y0, dy);
    for (Int i = 0; i < nv; i++) dv[i] = st->v0[i] - v0[i];
    follow(t, st, dy, dv);
    for (Int i = 0; i < x->times[k]; i++) {
      pinflex_place(t, st);
      pinflex_residuals(t, memory, s, st->y, st->v, st->a, st->lam, st->scale, st->r, st->open);
      pinflex_correct(t, st);
    }
    take(x->change + k * s * nv, st->change, s * nv);
    pinflex_place(t, st); /* and what the last correction has moved, for the next step */
    take(x->y + (k + 1) * nq, st->y + (s - 1) * nq, nq);
    take(x->v + (k + 1) * nv, st->v + (s - 1) * nv, nv);
  }
  return x->count;
}
