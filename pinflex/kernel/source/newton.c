/* Newton's equations of a collocation step. For each eigenvalue mu of A^-1, with dz = A^2 da,

     [ mu^2 M + h mu C + h^2 K    J' ] [  dz  ]     [ r      ]
     [ J                          0  ] [ -dlam] = - [ c/h^2  ]

   Groups of unknowns are factored as dense blocks, and what they do not touch is left out
   (sparsity.c). Coordinates need no pivots of other groups: with mu in the right half plane the real
   part of the matrix over mu is positive definite, but for forces that drive. Where a pivot is small
   nevertheless, all are one group. Factors lie column by column, real parts before imaginary ones. */
#include "chain.h"
#include "lu.h"
#include "march.h"
#include "sparsity.h"
#include <stddef.h>

static const double SMALL = 1e-6; /* of its column: a pivot that costs digits */

static Int size_of(const Tables *t, const Stages *st) { return st->free + t->closures; }

/* u + iv -= (p + iq) (a + ib), n entries */
static void subtract(Int n, double p, double q, const double *restrict a, const double *restrict b,
                     double *restrict u, double *restrict v) {
  Lane x = lane(p), y = lane(q);
  Int i = 0;
  for (; i + LANES <= n; i += LANES) {
    Lane e = *(const LooseLane *)(a + i), f = *(const LooseLane *)(b + i);
    *(LooseLane *)(u + i) -= e * x - f * y, *(LooseLane *)(v + i) -= e * y + f * x;
  }
  for (; i < n; i++) u[i] -= a[i] * p - b[i] * q, v[i] -= a[i] * q + b[i] * p;
}

/* The same with two columns at once: what is read and written of u and v is halved. */
static void subtract_two(Int n, const double *p, const double *q, const double *restrict a,
                         const double *restrict b, const double *restrict c,
                         const double *restrict d, double *restrict u, double *restrict v) {
  Lane p0 = lane(p[0]), p1 = lane(p[1]), q0 = lane(q[0]), q1 = lane(q[1]);
  Int i = 0;
  for (; i + LANES <= n; i += LANES) {
    Lane e = *(const LooseLane *)(a + i), f = *(const LooseLane *)(b + i);
    Lane g = *(const LooseLane *)(c + i), k = *(const LooseLane *)(d + i);
    *(LooseLane *)(u + i) -= e * p0 - f * q0 + (g * p1 - k * q1);
    *(LooseLane *)(v + i) -= e * q0 + f * p0 + (g * q1 + k * p1);
  }
  for (; i < n; i++) {
    u[i] -= a[i] * p[0] - b[i] * q[0] + (c[i] * p[1] - d[i] * q[1]);
    v[i] -= a[i] * q[0] + b[i] * p[0] + (c[i] * q[1] + d[i] * p[1]);
  }
}

/* Rows from `first` on to the end of a group, and those of its spans: [0, 1), [2, 3) ... of `rows`. */
static Int rows_of(const Group *g, Int first, Int *rows) {
  Int n = 2;
  rows[0] = first, rows[1] = g->end;
  for (Int k = 0; k < 2 * g->spans; k += 2) {
    if (g->at[k] != rows[n - 1]) rows[n++] = g->at[k], n++;
    rows[n - 1] = g->at[k + 1];
  }
  return n;
}

/* Swap two rows of a group, in its columns from `first` on and in those that it touches. */
static void swap_rows(double *A, Int n, Int first, const Group *g, Int i, Int j) {
  Int at[2 * SPANS + 2], ends = rows_of(g, first, at);
  for (Int c = 0; c < ends; c += 2)
    for (Int k = at[c]; k < at[c + 1]; k++) {
      double x = A[k * n + i];
      A[k * n + i] = A[k * n + j], A[k * n + j] = x;
    }
}

/* Find the pivot of column k in its group, bring it up, and divide what is below; 0 where it is none. */
static int eliminate(double *re, double *im, Int n, Int k, Int first, const Group *g, Int *pivot) {
  double *a = re + k * n, *b = im + k * n, most = -1.0, below = 0.0;
  for (Int i = k; i < g->end; i++) {
    double x = fabs(a[i]) + fabs(b[i]);
    if (x > most) most = x, pivot[k] = i;
  }
  for (Int p = 0; p < g->spans; p++)
    for (Int i = g->at[2 * p]; i < g->at[2 * p + 1]; i++) below = fmax(below, fabs(a[i]) + fabs(b[i]));
  if (!(most > SMALL * below) || !(most < 1e300)) return 0;
  if (pivot[k] != k) swap_rows(re, n, first, g, k, pivot[k]), swap_rows(im, n, first, g, k, pivot[k]);
  double d = 1.0 / (a[k] * a[k] + b[k] * b[k]), x = a[k] * d, y = -b[k] * d;
  Int at[2 * SPANS + 2], ends = rows_of(g, k + 1, at);
  for (Int r = 0; r < ends; r += 2)
    for (Int i = at[r]; i < at[r + 1]; i++) {
      double p = a[i], q = b[i];
      a[i] = p * x - q * y, b[i] = p * y + q * x;
    }
  return 1;
}

/* Columns k and k + 1, eliminated, taken off the columns of a group and of its spans. */
static void take_off(double *re, double *im, Int n, Int k, const Group *g) {
  const double *a = re + k * n, *b = im + k * n, *c = a + n, *d = b + n;
  Int at[2 * SPANS + 2], ends = rows_of(g, k + 2, at);
  for (Int s = 0; s < ends; s += 2)
    for (Int j = at[s]; j < at[s + 1]; j++) {
      double *u = re + j * n, *v = im + j * n, *p = u + k, *q = v + k;
      p[1] -= a[k + 1] * p[0] - b[k + 1] * q[0];
      q[1] -= a[k + 1] * q[0] + b[k + 1] * p[0];
      if (p[0] == 0.0 && q[0] == 0.0 && p[1] == 0.0 && q[1] == 0.0) continue;
      for (Int r = 0; r < ends; r += 2) {
        Int i = at[r];
        subtract_two(at[r + 1] - i, p, q, a + i, b + i, c + i, d + i, u + i, v + i);
      }
    }
}

/* Column k alone, eliminated, taken off columns `first` to `end`. */
static void take_off_one(double *re, double *im, Int n, Int k, Int first, Int end, const Group *g) {
  const double *a = re + k * n, *b = im + k * n;
  Int at[2 * SPANS + 2], ends = rows_of(g, k + 1, at);
  for (Int j = first; j < end; j++)
    for (Int r = 0; r < ends; r += 2) {
      double *u = re + j * n, *v = im + j * n;
      subtract(at[r + 1] - at[r], u[k], v[k], a + at[r], b + at[r], u + at[r], v + at[r]);
    }
}

/* Complex LU, group by group, two columns at a time, with pivots of the same group; 0 where one is
   none. */
static int decompose(double *re, double *im, Int n, const Sparsity *s, Int *pivot) {
  const Group *g = s->group;
  for (Int first = 0; first < n; first = g++->end)
    for (Int k = first; k < g->end; k += 2) {
      if (!eliminate(re, im, n, k, first, g, pivot)) return 0;
      if (k + 1 == g->end) {
        for (Int p = 0; p < g->spans; p++)
          take_off_one(re, im, n, k, g->at[2 * p], g->at[2 * p + 1], g);
        break;
      }
      take_off_one(re, im, n, k, k + 1, k + 2, g);
      if (!eliminate(re, im, n, k + 1, first, g, pivot)) return 0;
      take_off(re, im, n, k, g);
    }
  return 1;
}

/* x + iy over a + ib */
static void divide(double a, double b, double *x, double *y) {
  double d = 1.0 / (a * a + b * b), p = (*x * a + *y * b) * d;
  *y = (*y * a - *x * b) * d, *x = p;
}

/* What multipliers of a group take off the unknowns below, two columns at a time. */
static void forward(const double *re, const double *im, Int n, Int first, const Group *g, double *x,
                    double *y) {
  Int at[2 * SPANS + 2];
  for (Int k = first; k < g->end; k += 2) {
    const double *a = re + k * n, *b = im + k * n;
    if (k + 1 < g->end) subtract(1, x[k], y[k], a + k + 1, b + k + 1, x + k + 1, y + k + 1);
    for (Int r = 0, ends = rows_of(g, k + 2 < g->end ? k + 2 : g->end, at); r < ends; r += 2) {
      Int i = at[r], rows = at[r + 1] - i;
      if (k + 1 == g->end) subtract(rows, x[k], y[k], a + i, b + i, x + i, y + i);
      else subtract_two(rows, x + k, y + k, a + i, b + i, a + n + i, b + n + i, x + i, y + i);
    }
  }
}

static void substitute(const double *re, const double *im, Int n, const Sparsity *s, const Int *pivot,
                       double *x, double *y) {
  const Group *g = s->group;
  for (Int first = 0; first < n; first = g++->end) {
    for (Int k = first; k < g->end; k++) {
      double p = x[pivot[k]], q = y[pivot[k]];
      x[pivot[k]] = x[k], y[pivot[k]] = y[k];
      x[k] = p, y[k] = q;
    }
    forward(re, im, n, first, g, x, y);
  }
  for (Int k = n - 1; k >= 0; k -= 2) {
    const double *a = re + k * n, *b = im + k * n;
    divide(a[k], b[k], x + k, y + k);
    if (k == 0) break;
    subtract(1, x[k], y[k], a + k - 1, b + k - 1, x + k - 1, y + k - 1);
    divide(a[k - 1 - n], b[k - 1 - n], x + k - 1, y + k - 1);
    Int i = s->top[k] < s->top[k - 1] ? s->top[k] : s->top[k - 1];
    if (i < k - 1)
      subtract_two(k - 1 - i, x + k - 1, y + k - 1, a - n + i, b - n + i, a + i, b + i, x + i, y + i);
  }
}

/* Column of the matrix of an eigenvalue, its unknowns in order: entries that links know. */
static void assemble(const Tables *t, const Stages *st, Int e, const Sparsity *s, Int column,
                     double *re, double *im) {
  Int free = st->free, n = size_of(t, st);
  const uint64_t *linked = s->links + column * words_of(n);
  double h = st->h, x = st->value[2 * e], y = st->value[2 * e + 1];
  double square = x * x - y * y, cross = 2 * x * y;
  if (*s->groups <= DENSE && column < free) { /* in order as they are */
    for (Int j = 0; j < free; j++) {
      Int entry = j * free + column;
      double M = st->M[entry], C = h * st->C[entry];
      re[j] = square * M + x * C + h * h * st->K[entry], im[j] = cross * M + y * C;
    }
    for (Int k = free; k < n; k++) re[k] = st->J[(k - free) * free + column], im[k] = 0.0;
    return;
  }
  for (Int i = 0; i < n; i++) re[i] = im[i] = 0.0;
  if (column >= free && *s->groups <= DENSE) {
    copy(re, st->J + (column - free) * free, free);
    return;
  }
  if (column >= free) {
    const double *J = st->J + (column - free) * free;
    for (Int j = next_of(linked, 0, free); j < free; j = next_of(linked, j + 1, free))
      re[s->place[j]] = J[j];
    return;
  }
  for (Int j = next_of(linked, 0, free); j < free; j = next_of(linked, j + 1, free)) {
    Int i = s->place[j], entry = j * free + column;
    double M = st->M[entry], C = h * st->C[entry];
    re[i] = square * M + x * C + h * h * st->K[entry], im[i] = cross * M + y * C;
  }
  for (Int k = free; k < n; k++) re[s->place[k]] = st->J[(k - free) * free + column];
}

/* Of an odd number of stages one eigenvalue is real, and so is its matrix. */
static int is_real(const Stages *st, Int e) { return st->value[2 * e + 1] == 0.0; }

static int factored(const Tables *t, const Stages *st) {
  Int n = size_of(t, st);
  Sparsity s = sparsity(t, st);
  for (Int e = 0; e < st->values; e++) {
    double *re = st->lu + 2 * e * n * n, *im = re + n * n;
    Int *pivot = st->pivot + e * n;
    for (Int j = 0; j < n; j++) assemble(t, st, e, &s, s.order[j], re + j * n, im + j * n);
    if (!(is_real(st, e) ? factors(re, n, pivot) : decompose(re, im, n, &s, pivot))) return 0;
  }
  return 1;
}

/* Factors of the step; returns 0 where the matrix of one eigenvalue is singular. */
EXPORT int pinflex_factor(const Tables *t, const Stages *st) {
  find_sparsity(t, st);
  if (factored(t, st)) return 1;
  dense(t, st);
  return factored(t, st);
}

/* The same of a tangent: M, C, K (nv, nv), J (rows, nv) and, of a chain, what its blocks ask of each other. */
EXPORT int pinflex_factor_tangent(const Tables *t, Stages *st, const double *M) {
  Int n = st->free, nv = t->nv, square = nv * nv;
  const double *J = M + 3 * square;
  st->joined = t->joined_at[t->blocks] ? J + nv * t->closures : NULL;
  if (st->joined) {
    dense(t, st); /* unknowns in order as they are */
    st->joined_h = st->h;
    for (Int e = 0; e < st->values; e++)
      if (!chain_factors(t, st, e, M)) return 0;
    return 1;
  }
  for (Int i = 0; i < n; i++)
    for (Int j = 0; j < n; j++) {
      const double *at = M + st->free_at[i] * nv + st->free_at[j];
      st->M[i * n + j] = at[0], st->C[i * n + j] = at[square], st->K[i * n + j] = at[2 * square];
    }
  for (Int k = 0; k < t->closures; k++)
    for (Int j = 0; j < n; j++) st->J[k * n + j] = J[k * nv + st->free_at[j]];
  return pinflex_factor(t, st);
}

/* Right sides along the eigenvectors, forward times -(r, c / h^2), in order. */
static void project_stages(const Tables *t, const Stages *st, Int e, const Int *order, double *x,
                           double *y) {
  Int n = st->free, rows = t->closures, size = n + rows;
  for (Int i = 0; i < size; i++) x[i] = y[i] = 0.0;
  for (Int k = 0; k < st->s; k++) {
    double p = -st->forward[2 * (e * st->s + k)], q = -st->forward[2 * (e * st->s + k) + 1];
    for (Int i = 0; i < size; i++) {
      Int j = order[i];
      double r = j < n ? st->r[k * t->nv + st->free_at[j]]
                       : st->open[k * rows + j - n] / (st->h * st->h);
      x[i] += p * r, y[i] += q * r;
    }
  }
}

/* dlam, and dz in `change`, from the residuals. */
EXPORT void pinflex_solve(const Tables *t, const Stages *st) {
  Int n = st->free, rows = t->closures, size = size_of(t, st), s = st->s, nv = t->nv;
  Sparsity known = sparsity(t, st);
  const Int *order = known.order;
  for (Int e = 0; e < st->values; e++) {
    const double *re = st->lu + 2 * e * size * size;
    double *x = st->part + 2 * e * size, *y = x + size;
    const Int *pivot = st->pivot + e * size;
    project_stages(t, st, e, order, x, y);
    if (st->joined) chain_solve(t, st, e, x, y);
    else if (is_real(st, e)) solve(re, size, pivot, x);
    else substitute(re, re + size * size, size, &known, pivot, x, y);
  }
  for (Int k = 0; k < s; k++) {
    for (Int j = 0; j < rows; j++) st->dlam[k * rows + j] = 0.0;
    for (Int j = 0; j < n; j++) st->change[k * nv + st->free_at[j]] = 0.0;
    for (Int e = 0; e < st->values; e++) {
      const double *x = st->part + 2 * e * size, *y = x + size;
      double p = st->back[2 * (k * st->values + e)], q = st->back[2 * (k * st->values + e) + 1];
      for (Int i = 0; i < size; i++) {
        Int j = order[i];
        if (j < n) st->change[k * nv + st->free_at[j]] += p * x[i] - q * y[i];
        else st->dlam[k * rows + j - n] -= p * x[i] - q * y[i];
      }
    }
  }
}

/* Corrections of the stages from their residuals: da, dlam, change; a and lam go along. */
EXPORT void pinflex_correct(const Tables *t, const Stages *st) {
  Int n = st->free, rows = t->closures, s = st->s, nv = t->nv;
  pinflex_solve(t, st);
  for (Int k = 0; k < s; k++) {
    for (Int j = 0; j < rows; j++) st->lam[k * rows + j] += st->dlam[k * rows + j];
    for (Int j = 0; j < n; j++) {
      double sum = 0.0;
      for (Int l = 0; l < s; l++)
        sum += st->A2_inverse[k * s + l] * st->change[l * nv + st->free_at[j]];
      st->da[k * n + j] = sum;
      st->a[k * nv + st->free_at[j]] += sum;
    }
  }
  for (Int k = 0; k < s; k++)
    for (Int j = 0; j < n; j++) st->change[k * nv + st->free_at[j]] *= st->h * st->h;
}
