/* Real systems of equations: LU with row pivots. */
#include "lu.h"

enum { PANEL = 4 };

/* The next columns of a panel: pivots, and multipliers below. 0 where a pivot is none. */
static int panel(double *A, Int n, Int k, Int end, Int *pivot) {
  for (Int c = k; c < end; c++) {
    double *u = A + c * n, largest = -1.0;
    for (Int p = k; p < c; p++) {
      double x = u[pivot[p]];
      u[pivot[p]] = u[p], u[p] = x;
    }
    for (Int p = k; p < c; p++) {
      const double *l = A + p * n;
      double x = u[p];
      if (x != 0.0)
        for (Int i = p + 1; i < n; i++) u[i] -= x * l[i];
    }
    for (Int i = c; i < n; i++)
      if (fabs(u[i]) > largest) largest = fabs(u[i]), pivot[c] = i;
    if (!(largest > 0.0) || !(largest < 1e300)) return 0;
    double x = u[pivot[c]], inverse = 1.0 / x;
    u[pivot[c]] = u[c], u[c] = x;
    for (Int i = c + 1; i < n; i++) u[i] *= inverse;
    if (pivot[c] != c) /* multipliers of earlier columns of the panel go along */
      for (Int p = k; p < c; p++) {
        double *l = A + p * n, y = l[c];
        l[c] = l[pivot[c]], l[pivot[c]] = y;
      }
  }
  return 1;
}

/* One column behind a full panel: swapped, its rows beside the panel solved for. */
static int beside(const double *A, Int n, Int k, const Int *pivot, double *u) {
  for (Int p = k; p < k + PANEL; p++) {
    double x = u[pivot[p]];
    u[pivot[p]] = u[p], u[p] = x;
  }
  for (Int p = k; p < k + PANEL; p++)
    for (Int i = p + 1; i < k + PANEL; i++) u[i] -= A[p * n + i] * u[p];
  return u[k] != 0.0 || u[k + 1] != 0.0 || u[k + 2] != 0.0 || u[k + 3] != 0.0;
}

/* Columns u, w of length m less the panel's times x, y: two at a time share what is read. */
static void take_off(const double *restrict p, Int n, Int m, const double *restrict x,
                     const double *restrict y, double *restrict u, double *restrict w) {
  const double *restrict a = p, *restrict b = p + n, *restrict c = p + 2 * n,
               *restrict d = p + 3 * n;
  double x0 = x[0], x1 = x[1], x2 = x[2], x3 = x[3], y0 = y[0], y1 = y[1], y2 = y[2], y3 = y[3];
  for (Int i = 0; i < m; i++) {
    double e = a[i], f = b[i], g = c[i], q = d[i];
    u[i] -= e * x0 + f * x1 + g * x2 + q * x3;
    w[i] -= e * y0 + f * y1 + g * y2 + q * y3;
  }
}

static void take_off_one(const double *restrict p, Int n, Int m, const double *restrict x,
                         double *restrict u) {
  const double *restrict a = p, *restrict b = p + n, *restrict c = p + 2 * n,
               *restrict d = p + 3 * n;
  double x0 = x[0], x1 = x[1], x2 = x[2], x3 = x[3];
  for (Int i = 0; i < m; i++) u[i] -= a[i] * x0 + b[i] * x1 + c[i] * x2 + d[i] * x3;
}

/* LU with row pivots, columns one after the other, PANEL columns at a time; the swaps of a panel are
   not applied to the multipliers before it (`solve` swaps as it goes). */
int factors(double *A, Int n, Int *pivot) {
  for (Int k = 0; k < n; k += PANEL) {
    Int end = k + PANEL < n ? k + PANEL : n;
    if (!panel(A, n, k, end, pivot)) return 0;
    const double *below = A + k * n + end;
    Int wait = -1;
    for (Int j = end; j < n; j++) {
      if (!beside(A, n, k, pivot, A + j * n)) continue;
      if (wait < 0) {
        wait = j;
        continue;
      }
      double *u = A + wait * n, *w = A + j * n;
      take_off(below, n, n - end, u + k, w + k, u + end, w + end);
      wait = -1;
    }
    if (wait >= 0) take_off_one(below, n, n - end, A + wait * n + k, A + wait * n + end);
  }
  return 1;
}

void solve(const double *A, Int n, const Int *pivot, double *x) {
  for (Int k = 0; k < n; k += PANEL) {
    Int end = k + PANEL < n ? k + PANEL : n;
    for (Int p = k; p < end; p++) {
      double y = x[pivot[p]];
      x[pivot[p]] = x[p], x[p] = y;
    }
    for (Int p = k; p < end; p++) {
      const double *l = A + p * n;
      double y = x[p];
      if (y != 0.0)
        for (Int i = p + 1; i < n; i++) x[i] -= l[i] * y;
    }
  }
  for (Int k = n - 1; k >= 0; k--) {
    const double *u = A + k * n;
    double y = x[k] / u[k];
    x[k] = y;
    if (y != 0.0)
      for (Int i = 0; i < k; i++) x[i] -= u[i] * y;
  }
}
