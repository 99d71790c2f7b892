/* Consistent accelerations and multipliers at (t, y, v): where steps begin.

     [ M  J' ] [  a  ]     [ r   ]
     [ J  0  ] [ -lam] = - [ c'' ]

   in the free rows, r and c'' those of a motion in which prescribed motors alone are accelerated.
   Rows and columns are scaled by the roots of M's diagonal. Coordinates without mass leave a and lam
   open: their balance is algebraic, and the least of the answers seeds the first step. */
#include "lu.h"
#include "march.h"
#include <stddef.h>

/* Scales of the unknowns: multipliers as they are. */
static void scales(const Stages *st, Int nv, Int rows, const double *M, double *to) {
  double most = 0.0;
  for (Int i = 0; i < st->free; i++) most = fmax(most, fabs(M[st->free_at[i] * (nv + 1)]));
  for (Int i = 0; i < st->free; i++) {
    double size = fabs(M[st->free_at[i] * (nv + 1)]);
    to[i] = 1.0 / sqrt(fmax(size, fmax(1e-12 * most, 1e-300)));
  }
  for (Int k = 0; k < rows; k++) to[st->free + k] = 1.0;
}

/* The matrix above, column after column; scales are left behind start_x. */
static void fill(const Tables *t, March *m, const double *M) {
  const Stages *st = m->stages;
  Int n = st->free, rows = t->closures, size = n + rows, nv = t->nv;
  double *scale = m->start_x + size, *S = m->start_lu;
  const double *J = M + 3 * nv * nv;
  scales(st, nv, rows, M, scale);
  for (Int i = 0; i < size * size; i++) S[i] = 0.0;
  for (Int i = 0; i < n; i++) {
    for (Int j = 0; j < n; j++)
      S[j * size + i] = M[st->free_at[i] * nv + st->free_at[j]] * scale[i] * scale[j];
    for (Int k = 0; k < rows; k++)
      S[(n + k) * size + i] = S[i * size + n + k] = J[k * nv + st->free_at[i]] * scale[i];
  }
}

static int factor_start(const Tables *t, March *m, const double *M) {
  Int size = m->stages->free + t->closures;
  fill(t, m, M);
  return factors(m->start_lu, size, m->start_pivot) && regular(m->start_lu, size);
}

/* What is solved for, of residuals r and second derivatives of the closures. */
static void right_side(const Tables *t, const March *m, const double *r, const double *rates,
                       double *x) {
  const Stages *st = m->stages;
  const double *scale = m->start_x + st->free + t->closures;
  for (Int i = 0; i < st->free; i++) x[i] = -r[st->free_at[i]] * scale[i];
  for (Int k = 0; k < t->closures; k++) x[st->free + k] = -rates[k];
}

static void move_start(const Tables *t, March *m, const double *x) {
  const Stages *st = m->stages;
  const double *scale = m->start_x + st->free + t->closures;
  for (Int i = 0; i < st->free; i++) m->a[st->free_at[i]] += scale[i] * x[i];
  for (Int k = 0; k < t->closures; k++) m->lam[k] -= x[st->free + k];
}

/* a and lam moved so that residuals and second derivatives of the closures end. */
static void solve_start(const Tables *t, March *m, const double *r, const double *rates) {
  Int size = m->stages->free + t->closures;
  double *x = m->stages->part;
  right_side(t, m, r, rates, x);
  solve(m->start_lu, size, m->start_pivot, x);
  move_start(t, m, x);
}

/* The same where coordinates have no mass. */
static int least_start(const Tables *t, March *m, const double *M, const double *r,
                       const double *rates) {
  Int size = m->stages->free + t->closures;
  double *S = m->start_lu, *b = m->stages->part, *x = m->start_x;
  fill(t, m, M);
  right_side(t, m, r, rates, b);
  least_norm(S, size, b, S + size * size, m->start_pivot, x);
  for (Int i = 0; i < size; i++)
    if (!isfinite(x[i])) return 0;
  move_start(t, m, x);
  return 1;
}

int begin(const Tables *t, char *memory, March *m) {
  Stages *st = m->stages;
  Int n = st->free, rows = t->closures, size = n + rows, nv = t->nv, motors = st->motors;
  double *r = m->start_x + 2 * size, *rates = r + nv, *inputs = m->input;
  double *M = m->tangent_at + m->tangents * tangent_width(t);
  if (!m->given) prescribed(m->inputs, m->t, inputs);
  for (Int i = 0; i < nv; i++) m->a[i] = 0.0;
  for (Int k = 0; k < rows; k++) m->lam[k] = 0.0;
  Told told = {inputs, inputs + motors, inputs + 2 * motors};
  for (Int k = 0; k < led(st); k++) m->a[st->motor_v[k]] = told.feed[k];
  motion(t, memory, t->added ? WITH_RATES : MASS, m->y, m->v, m->a, m->lam, inputs + 3 * motors, M, r,
         rates);
  pull(t, st, &told, m->y, m->v, m->torque, r);
  if (factor_start(t, m, M)) solve_start(t, m, r, rates);
  else if (!least_start(t, m, M, r, rates)) return 0;
  if (!led(st)) return 1;
  pinflex_residuals(t, memory, 1, m->y, m->v, m->a, m->lam, inputs + 3 * motors, r, rates);
  pull(t, st, &told, m->y, m->v, m->torque, r);
  for (Int k = 0; k < led(st); k++) m->torque[k] = r[st->motor_v[k]];
  return 1;
}
