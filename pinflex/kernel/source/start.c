/* Consistent accelerations and multipliers at (t, y, v): where steps begin.

     [ M  J' ] [  a  ]     [ r   ]
     [ J  0  ] [ -lam] = - [ c'' ]

   in the free rows, r and c'' those of a motion in which prescribed motors alone are accelerated.
   Rows and columns are scaled by the roots of M's diagonal. */
#include "march.h"

/* Pivots that differ by more show coordinates without mass: then the answer is not unique. */
static const double SINGULAR = 1e-11;

static int regular(const double *lu, Int n) {
  double least = INFINITY, most = 0.0;
  for (Int k = 0; k < n; k++) {
    double x = fabs(lu[k * (n + 1)]);
    least = fmin(least, x), most = fmax(most, x);
  }
  return n == 0 || least > SINGULAR * most;
}

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

int begin(const Tables *t, char *memory, March *m) {
  Stages *st = m->stages;
  Int n = st->free, rows = t->closures, size = n + rows, nv = t->nv, motors = st->motors;
  double *x = m->start_x, *scale = x + size, *r = scale + size, *rates = r + nv;
  double *re = m->start_lu, *im = re + size * size, *inputs = m->input;
  double *M = m->tangent_at + m->tangents * tangent_width(t), *J = M + 3 * nv * nv;
  if (!m->given) prescribed(m->inputs, m->t, inputs);
  for (Int i = 0; i < nv; i++) m->a[i] = 0.0;
  for (Int k = 0; k < rows; k++) m->lam[k] = 0.0;
  Told told = {inputs, inputs + motors, inputs + 2 * motors};
  for (Int k = 0; k < led(st); k++) m->a[st->motor_v[k]] = told.feed[k];
  pinflex_motion(t, memory, m->y, m->v, m->a, m->lam, inputs + 3 * motors, M, r, rates);
  pull(st, &told, m->y, m->v, m->torque, r);
  scales(st, nv, rows, M, scale);
  for (Int i = 0; i < 2 * size * size; i++) re[i] = 0.0;
  for (Int i = 0; i < n; i++) {
    for (Int j = 0; j < n; j++)
      re[j * size + i] = M[st->free_at[i] * nv + st->free_at[j]] * scale[i] * scale[j];
    for (Int k = 0; k < rows; k++)
      re[(n + k) * size + i] = re[i * size + n + k] = J[k * nv + st->free_at[i]] * scale[i];
    x[i] = -r[st->free_at[i]] * scale[i];
  }
  for (Int k = 0; k < rows; k++) x[n + k] = -rates[k];
  if (!decompose(re, im, size, m->start_pivot) || !regular(re, size)) return 0;
  for (Int i = 0; i < size; i++) st->part[i] = x[i], st->part[size + i] = 0.0;
  substitute(re, im, size, m->start_pivot, st->part, st->part + size);
  for (Int i = 0; i < n; i++) m->a[st->free_at[i]] = scale[i] * st->part[i];
  for (Int k = 0; k < rows; k++) m->lam[k] = -st->part[n + k];
  if (!st->prescribed) return 1;
  pinflex_residuals(t, memory, 1, m->y, m->v, m->a, m->lam, inputs + 3 * motors, r, rates);
  for (Int k = 0; k < motors; k++) m->torque[k] = r[st->motor_v[k]];
  return 1;
}
