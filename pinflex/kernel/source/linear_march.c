/* March of a linear system on closures by a method of the alpha family:

     M a + C v + K d + r - J' lam = 0,   J d = 0

     [ S   J' ] [  ds  ]     [ r + C v + K d      ]
     [ J   0  ] [ -lam ] = - [ J d / (beta h^2)   ],    S = m M + gamma h C + beta h^2 K

   v and d on the right side are predicted. Most entries of S, C, K and J are constant; those
   that vary are given for each system, column by column. */
#include "kernel.h"
#include "lu.h"
#include <string.h>

typedef struct {
  Int n, rows, count, kept;          /* kept: whether there is room for the factors of all systems */
  const Int *col_at, *J_col_at;      /* [n+1] columns of the varying entries of S, C and K, and of J ... */
  const Int *row;                    /* [*col_at] ... and their rows */
  const Int *J_row;                  /* [*J_col_at] */
  const double *S;                   /* [n, n] constant entries, column by column */
  const double *J;                   /* [n, rows] */
  const Int *C_at, *K_at;            /* [n+1] of C and K the entries that are not zero */
  const Int *C_row;                  /* [*C_at] */
  const Int *K_row;                  /* [*K_at] */
  const double *C;                   /* [*C_at] */
  const double *K;                   /* [*K_at] */
  const Int *system;                 /* (count,): system of each step */
  const double *value;               /* (systems, .): S, C, K, J of the varying entries */
  const double *load;                /* (count, n): r */
  double *lu;                        /* room for factors: of one system, or of all */
  Int *pivot;                        /* [rooms, size] */
  Int *holds;                        /* [rooms] 1 + the system whose factors are there */
  double *state;                     /* [4, n] d, v, a and s */
  double *work;                      /* [size] */
  double *d, *v, *a, *lam;           /* (count, .) */
  double h, mass_factor, beta, gamma, alpha_m, alpha_f;
} Linear;

/* y += A x: entries by columns. */
static void times_sparse(Int n, const Int *col_at, const Int *row, const double *value,
                         const double *x, double *y) {
  for (Int j = 0; j < n; j++)
    for (Int p = col_at[j]; p < col_at[j + 1]; p++) y[row[p]] += value[p] * x[j];
}

/* y += J x: constant entries, and those that vary. */
static void times_rows(const Linear *m, const double *value, const double *x, double *y) {
  for (Int j = 0; m->rows && j < m->n; j++) {
    const double *column = m->J + j * m->rows;
    for (Int i = 0; i < m->rows; i++) y[i] += column[i] * x[j];
  }
  times_sparse(m->n, m->J_col_at, m->J_row, value, x, y);
}

/* Factors of a system, where they are not at hand; 0 where it is singular. The last coordinates come
   first: joints, which all links of their leg move with, would else fill what legs have apart. */
static const double *factored(const Linear *m, Int system, const double *value, const Int **pivot) {
  Int n = m->n, rows = m->rows, size = n + rows, at = m->kept ? system : 0;
  double *lu = m->lu + at * size * size;
  *pivot = m->pivot + at * size;
  if (m->holds[at] == system + 1) return lu;
  const double *J = value + 3 * m->col_at[n];
  for (Int j = 0; j < n; j++) {
    double *column = lu + (n - 1 - j) * size, *last = column + n;
    for (Int i = 0; i < n; i++) column[n - 1 - i] = m->S[j * n + i];
    for (Int p = m->col_at[j]; p < m->col_at[j + 1]; p++) column[n - 1 - m->row[p]] = value[p];
    memcpy(last, m->J + j * rows, (size_t)rows * sizeof(double));
    for (Int p = m->J_col_at[j]; p < m->J_col_at[j + 1]; p++) last[m->J_row[p]] = J[p];
    for (Int k = 0; k < rows; k++) lu[(n + k) * size + n - 1 - j] = last[k];
  }
  for (Int k = n; k < size; k++)
    memset(lu + k * size + n, 0, (size_t)rows * sizeof(double));
  m->holds[at] = system + 1;
  return factors(lu, size, m->pivot + at * size) ? lu : 0;
}

/* Steps from the state on; the number of those that were taken. */
EXPORT Int pinflex_linear_march(const Linear *m) {
  Int n = m->n, rows = m->rows, varying = m->col_at[n], width = 3 * varying + m->J_col_at[n];
  double h = m->h, beta = m->beta, gamma = m->gamma, *x = m->work;
  double *d = m->state, *v = d + n, *a = v + n, *s = a + n;
  for (Int k = 0; k < m->count; k++) {
    const double *value = m->value + m->system[k] * width;
    const Int *pivot;
    const double *lu = factored(m, m->system[k], value, &pivot);
    if (!lu) return k;
    for (Int i = 0; i < n; i++) {
      double next = (m->alpha_f * a[i] - m->alpha_m * s[i]) / (1.0 - m->alpha_m);
      d[i] += h * v[i] + h * h * ((0.5 - beta) * s[i] + beta * next);
      v[i] += h * ((1.0 - gamma) * s[i] + gamma * next);
      s[i] = next;
      x[i] = m->load[k * n + i];
    }
    for (Int i = 0; i < rows; i++) x[n + i] = 0.0;
    times_sparse(n, m->C_at, m->C_row, m->C, v, x);
    times_sparse(n, m->K_at, m->K_row, m->K, d, x);
    times_sparse(n, m->col_at, m->row, value + varying, v, x);
    times_sparse(n, m->col_at, m->row, value + 2 * varying, d, x);
    times_rows(m, value + 3 * varying, d, x + n);
    for (Int i = 0, j = n - 1; i <= j; i++, j--) {
      double y = -x[i];
      x[i] = -x[j], x[j] = y;
    }
    for (Int i = 0; i < rows; i++) x[n + i] /= -(beta * h * h);
    solve(lu, n + rows, pivot, x);
    for (Int i = 0; i < n; i++) {
      double ds = x[n - 1 - i];
      s[i] += ds;
      a[i] = m->mass_factor * ds;
      d[i] += h * h * beta * ds;
      v[i] += h * gamma * ds;
      m->d[k * n + i] = d[i], m->v[k * n + i] = v[i], m->a[k * n + i] = a[i];
    }
    for (Int i = 0; i < rows; i++) m->lam[k * rows + i] = -x[n + i];
  }
  return m->count;
}
