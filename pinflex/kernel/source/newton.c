/* Newton's equations of a collocation step. For each eigenvalue mu of A^-1, with dz = A^2 da,

     [ mu^2 M + h mu C + h^2 K    J' ] [  dz  ]     [ r      ]
     [ J                          0  ] [ -dlam] = - [ c/h^2  ]

   Factors lie column by column, real parts before imaginary ones. */
#include "march.h"

static Int size_of(const Tables *t, const Stages *st) { return st->free + t->closures; }

/* Swap two rows of a column-by-column matrix. */
static void swap_rows(double *A, Int n, Int i, Int j) {
  for (Int k = 0; k < n; k++) {
    double x = A[k * n + i];
    A[k * n + i] = A[k * n + j], A[k * n + j] = x;
  }
}

/* Complex LU with row pivots; 0 where a pivot is none. */
int decompose(double *re, double *im, Int n, Int *pivot) {
  for (Int k = 0; k < n; k++) {
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
    for (Int j = k + 1; j < n; j++) {
      double *u = re + j * n, *v = im + j * n, p = u[k], q = v[k];
      if (p == 0.0 && q == 0.0) continue;
      for (Int i = k + 1; i < n; i++) {
        u[i] -= a[i] * p - b[i] * q;
        v[i] -= a[i] * q + b[i] * p;
      }
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

/* Factors of the step; returns 0 where the matrix of one eigenvalue is singular. */
EXPORT int pinflex_factor(const Tables *t, const Stages *st) {
  Int n = st->free, rows = t->closures, size = size_of(t, st);
  double h = st->h;
  for (Int e = 0; e < st->values; e++) {
    double x = st->value[2 * e], y = st->value[2 * e + 1], square = x * x - y * y, cross = 2 * x * y;
    double *re = st->lu + 2 * e * size * size, *im = re + size * size;
    for (Int i = 0; i < n; i++)
      for (Int j = 0; j < n; j++) {
        double M = st->M[i * n + j], C = h * st->C[i * n + j];
        re[j * size + i] = square * M + x * C + h * h * st->K[i * n + j];
        im[j * size + i] = cross * M + y * C;
      }
    for (Int k = 0; k < rows; k++) {
      for (Int i = 0; i < n; i++) {
        re[(n + k) * size + i] = re[i * size + n + k] = st->J[k * n + i];
        im[(n + k) * size + i] = im[i * size + n + k] = 0.0;
      }
      for (Int l = 0; l < rows; l++) re[(n + k) * size + n + l] = im[(n + k) * size + n + l] = 0.0;
    }
    if (!decompose(re, im, size, st->pivot + e * size)) return 0;
  }
  return 1;
}

/* Right sides along the eigenvectors: forward times -(r, c / h^2). */
static void project_stages(const Tables *t, const Stages *st, Int e, double *x, double *y) {
  Int n = st->free, rows = t->closures;
  for (Int j = 0; j < n + rows; j++) x[j] = y[j] = 0.0;
  for (Int k = 0; k < st->s; k++) {
    double p = -st->forward[2 * (e * st->s + k)], q = -st->forward[2 * (e * st->s + k) + 1];
    for (Int j = 0; j < n; j++) {
      double r = st->r[k * t->nv + st->free_at[j]];
      x[j] += p * r, y[j] += q * r;
    }
    for (Int j = 0; j < rows; j++) {
      double c = st->open[k * rows + j] / (st->h * st->h);
      x[n + j] += p * c, y[n + j] += q * c;
    }
  }
}

/* dlam, and dz in `change`, from the residuals. */
EXPORT void pinflex_solve(const Tables *t, const Stages *st) {
  Int n = st->free, rows = t->closures, size = size_of(t, st), s = st->s, nv = t->nv;
  for (Int e = 0; e < st->values; e++) {
    const double *re = st->lu + 2 * e * size * size;
    double *x = st->part + 2 * e * size;
    project_stages(t, st, e, x, x + size);
    substitute(re, re + size * size, size, st->pivot + e * size, x, x + size);
  }
  for (Int k = 0; k < s; k++) {
    for (Int j = 0; j < rows; j++) st->dlam[k * rows + j] = 0.0;
    for (Int j = 0; j < n; j++) st->change[k * nv + st->free_at[j]] = 0.0;
    for (Int e = 0; e < st->values; e++) {
      const double *x = st->part + 2 * e * size, *y = x + size;
      double p = st->back[2 * (k * st->values + e)], q = st->back[2 * (k * st->values + e) + 1];
      for (Int j = 0; j < n; j++) st->change[k * nv + st->free_at[j]] += p * x[j] - q * y[j];
      for (Int j = 0; j < rows; j++) st->dlam[k * rows + j] -= p * x[n + j] - q * y[n + j];
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
