/* Newton's equations of a collocation step. For each eigenvalue mu of A^-1, with dz = A^2 da,

     [ mu^2 M + h mu C + h^2 K    J' ] [  dz  ]     [ r      ]
     [ J                          0  ] [ -dlam] = - [ c/h^2  ]

   Unknowns that no entry links, such as those of arms side by side, are factored apart, block by
   block. Factors lie column by column, real parts before imaginary ones. */
#include "lu.h"
#include "march.h"

static Int size_of(const Tables *t, const Stages *st) { return st->free + t->closures; }

/* Swap two rows of a column-by-column matrix. */
static void swap_rows(double *A, Int n, Int i, Int j) {
  for (Int k = 0; k < n; k++) {
    double x = A[k * n + i];
    A[k * n + i] = A[k * n + j], A[k * n + j] = x;
  }
}

/* Find the pivot of column k, bring it up, and divide what is below; 0 where it is none. */
static int eliminate(double *re, double *im, Int n, Int k, Int *pivot) {
  double *a = re + k * n, *b = im + k * n, largest = -1.0;
  for (Int i = k; i < n; i++) {
    double x = fabs(a[i]) + fabs(b[i]);
    if (x > largest) largest = x, pivot[k] = i;
  }
  if (!(largest > 0.0) || !(largest < 1e300)) return 0;
  if (pivot[k] != k) swap_rows(re, n, k, pivot[k]), swap_rows(im, n, k, pivot[k]);
  double d = 1.0 / (a[k] * a[k] + b[k] * b[k]), x = a[k] * d, y = -b[k] * d;
  for (Int i = k + 1; i < n; i++) {
    double p = a[i], q = b[i];
    a[i] = p * x - q * y, b[i] = p * y + q * x;
  }
  return 1;
}

/* u + iv -= (p + iq) (a + ib), n entries */
static void subtract(Int n, double p, double q, const double *restrict a, const double *restrict b,
                     double *restrict u, double *restrict v) {
  for (Int i = 0; i < n; i++) {
    u[i] -= a[i] * p - b[i] * q;
    v[i] -= a[i] * q + b[i] * p;
  }
}

/* The same with two columns at once: what is read and written of u and v is halved. */
static void subtract_two(Int n, const double *p, const double *q, const double *restrict a,
                         const double *restrict b, const double *restrict c,
                         const double *restrict d, double *restrict u, double *restrict v) {
  double p0 = p[0], p1 = p[1], q0 = q[0], q1 = q[1];
  for (Int i = 0; i < n; i++) {
    u[i] -= a[i] * p0 - b[i] * q0 + (c[i] * p1 - d[i] * q1);
    v[i] -= a[i] * q0 + b[i] * p0 + (c[i] * q1 + d[i] * p1);
  }
}

/* Complex LU with row pivots, two columns at a time; 0 where a pivot is none. */
int decompose(double *re, double *im, Int n, Int *pivot) {
  for (Int k = 0; k < n; k += 2) {
    double *a = re + k * n, *b = im + k * n, *c = a + n, *d = b + n;
    if (!eliminate(re, im, n, k, pivot)) return 0;
    if (k + 1 == n) break;
    subtract(n - k - 1, c[k], d[k], a + k + 1, b + k + 1, c + k + 1, d + k + 1);
    if (!eliminate(re, im, n, k + 1, pivot)) return 0;
    for (Int j = k + 2; j < n; j++) {
      double *u = re + j * n + k, *v = im + j * n + k;
      u[1] -= a[k + 1] * u[0] - b[k + 1] * v[0];
      v[1] -= a[k + 1] * v[0] + b[k + 1] * u[0];
      if (u[0] == 0.0 && v[0] == 0.0 && u[1] == 0.0 && v[1] == 0.0) continue;
      subtract_two(n - k - 2, u, v, a + k + 2, b + k + 2, c + k + 2, d + k + 2, u + 2, v + 2);
    }
  }
  return 1;
}

void substitute(const double *re, const double *im, Int n, const Int *pivot, double *x, double *y) {
  for (Int k = 0; k < n; k++) {
    double p = x[pivot[k]], q = y[pivot[k]];
    x[pivot[k]] = x[k], y[pivot[k]] = y[k];
    x[k] = p, y[k] = q;
  }
  for (Int k = 0; k < n; k++) {
    const double *a = re + k * n, *b = im + k * n;
    double p = x[k], q = y[k];
    for (Int i = k + 1; i < n; i++) x[i] -= a[i] * p - b[i] * q, y[i] -= a[i] * q + b[i] * p;
  }
  for (Int k = n - 1; k >= 0; k--) {
    const double *a = re + k * n, *b = im + k * n;
    double d = 1.0 / (a[k] * a[k] + b[k] * b[k]);
    double p = (x[k] * a[k] + y[k] * b[k]) * d, q = (y[k] * a[k] - x[k] * b[k]) * d;
    x[k] = p, y[k] = q;
    for (Int i = 0; i < k; i++) x[i] -= a[i] * p - b[i] * q, y[i] -= a[i] * q + b[i] * p;
  }
}

/* Behind the pivots: the unknowns (free rows, then closures) block by block, the number of blocks,
   and where each ends. */
static Int *order_of(const Tables *t, const Stages *st) {
  return st->pivot + st->values * size_of(t, st);
}

/* Whether an entry links two unknowns. */
static int linked(const Stages *st, Int i, Int j) {
  Int n = st->free, there = i * n + j, back = j * n + i;
  if (i >= n || j >= n)
    return i < n ? st->J[back - n * n] != 0.0 : j < n && st->J[there - n * n] != 0.0;
  return st->M[there] != 0.0 || st->K[there] != 0.0 || st->C[there] != 0.0 || st->M[back] != 0.0
         || st->K[back] != 0.0 || st->C[back] != 0.0;
}

/* Blocks of unknowns, each in order: from one unknown to all that it is linked to, and on. */
static void find_blocks(const Tables *t, const Stages *st) {
  Int size = size_of(t, st), found = 0, blocks = 0, *seen = st->pivot;
  Int *order = order_of(t, st), *ends = order + size;
  for (Int i = 0; i < size; i++) seen[i] = 0;
  for (Int first = 0; first < size; first++) {
    if (seen[first]) continue;
    Int begin = found;
    seen[first] = 1, order[found++] = first;
    for (Int k = begin; k < found && found < size; k++)
      for (Int j = first + 1; j < size; j++)
        if (!seen[j] && linked(st, order[k], j)) seen[j] = 1, order[found++] = j;
    for (Int k = begin + 1; k < found; k++) { /* hardly ever far out of order */
      Int j = order[k], to = k;
      for (; to > begin && order[to - 1] > j; to--) order[to] = order[to - 1];
      order[to] = j;
    }
    ends[++blocks] = found;
  }
  ends[0] = blocks;
}

/* One block of the matrix of an eigenvalue, of n unknowns. */
static void assemble(const Stages *st, Int e, const Int *at, Int n, double *re, double *im) {
  Int free = st->free, moving = 0;
  double h = st->h, x = st->value[2 * e], y = st->value[2 * e + 1];
  double square = x * x - y * y, cross = 2 * x * y;
  while (moving < n && at[moving] < free) moving++;
  for (Int i = 0; i < moving; i++)
    for (Int j = 0; j < moving; j++) {
      Int entry = at[i] * free + at[j];
      double M = st->M[entry], C = h * st->C[entry];
      re[j * n + i] = square * M + x * C + h * h * st->K[entry];
      im[j * n + i] = cross * M + y * C;
    }
  for (Int k = moving; k < n; k++) {
    const double *row = st->J + (at[k] - free) * free;
    for (Int i = 0; i < n; i++) {
      re[k * n + i] = re[i * n + k] = i < moving ? row[at[i]] : 0.0;
      im[k * n + i] = im[i * n + k] = 0.0;
    }
  }
}

/* Of an odd number of stages one eigenvalue is real, and so is its matrix. */
static int is_real(const Stages *st, Int e) { return st->value[2 * e + 1] == 0.0; }

/* Factors of the step; returns 0 where the matrix of one eigenvalue is singular. */
EXPORT int pinflex_factor(const Tables *t, const Stages *st) {
  Int size = size_of(t, st), *order = order_of(t, st), *ends = order + size;
  find_blocks(t, st);
  for (Int e = 0; e < st->values; e++) {
    double *re = st->lu + 2 * e * size * size;
    for (Int b = 1, first = 0; b <= ends[0]; first = ends[b++]) {
      Int n = ends[b] - first;
      assemble(st, e, order + first, n, re, re + n * n);
      Int *pivot = st->pivot + e * size + first;
      if (!(is_real(st, e) ? factors(re, n, pivot) : decompose(re, re + n * n, n, pivot))) return 0;
      re += 2 * n * n;
    }
  }
  return 1;
}

/* Right sides along the eigenvectors, forward times -(r, c / h^2), block by block. */
static void project_stages(const Tables *t, const Stages *st, Int e, double *x, double *y) {
  Int n = st->free, rows = t->closures, size = n + rows, *order = order_of(t, st);
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
  Int *order = order_of(t, st), *ends = order + size;
  for (Int e = 0; e < st->values; e++) {
    const double *re = st->lu + 2 * e * size * size;
    double *x = st->part + 2 * e * size, *y = x + size;
    project_stages(t, st, e, x, y);
    for (Int b = 1, first = 0; b <= ends[0]; first = ends[b++]) {
      Int m = ends[b] - first;
      const Int *pivot = st->pivot + e * size + first;
      if (is_real(st, e)) solve(re, m, pivot, x + first);
      else substitute(re, re + m * m, m, pivot, x + first, y + first);
      re += 2 * m * m;
    }
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
