/* The shortest x that minimises |A x - b| where A may be singular: Householder's QR with column
   pivots, A P = Q [R T; 0 0], ends where what is left is round-off; then with y = R^-1 Q'b, W = R^-1 T

     P' x = (y - W z, z),   (1 + W'W) z = W'y

   Source: Golub and Van Loan (2013), 5.5. Matrices column after column. */
#include "lu.h"
#include <math.h>

static const double ROUND_OFF = 1e-13; /* of the first pivot */

static double square(const double *x, Int n) {
  double sum = 0.0;
  for (Int i = 0; i < n; i++) sum += x[i] * x[i];
  return sum;
}

/* c less its part along v, twice: the reflection. */
static void reflect(const double *v, double half, Int n, double *c) {
  double along = 0.0;
  for (Int i = 0; i < n; i++) along += v[i] * c[i];
  for (Int i = 0; i < n; i++) c[i] -= along / half * v[i];
}

/* R in the upper triangle of A and Q'b in b; the rank. */
static Int reduce(double *A, Int n, Int *order, double *b) {
  double first = 0.0;
  for (Int k = 0; k < n; k++) {
    Int best = k;
    double most = -1.0;
    for (Int j = k; j < n; j++) {
      double size = square(A + j * n + k, n - k);
      if (size > most) most = size, best = j;
    }
    double length = sqrt(most);
    if (k == 0) first = length;
    if (!(length > ROUND_OFF * first)) return k;
    for (Int i = 0; i < n; i++) {
      double x = A[k * n + i];
      A[k * n + i] = A[best * n + i], A[best * n + i] = x;
    }
    Int column = order[k];
    order[k] = order[best], order[best] = column;
    double *v = A + k * n + k, pivot = v[0] > 0.0 ? -length : length;
    v[0] -= pivot;
    double half = 0.5 * square(v, n - k);
    for (Int j = k + 1; j < n; j++) reflect(v, half, n - k, A + j * n + k);
    reflect(v, half, n - k, b + k);
    v[0] = pivot;
  }
  return n;
}

static void back(const double *R, Int n, Int rank, double *x) {
  for (Int i = rank - 1; i >= 0; i--) {
    x[i] /= R[i * n + i];
    for (Int k = 0; k < i; k++) x[k] -= R[i * n + k] * x[i];
  }
}

/* z of (1 + W'W) z = W'y, W the columns of A behind the rank; G: room for (spare, spare + 1). */
static void spare_part(const double *W, Int n, Int rank, const double *y, double *G, Int *pivot) {
  Int spare = n - rank;
  double *z = G + spare * spare;
  for (Int i = 0; i < spare; i++) {
    z[i] = 0.0;
    for (Int k = 0; k < rank; k++) z[i] += W[i * n + k] * y[k];
    for (Int j = 0; j < spare; j++) {
      G[j * spare + i] = i == j;
      for (Int k = 0; k < rank; k++) G[j * spare + i] += W[i * n + k] * W[j * n + k];
    }
  }
  factors(G, spare, pivot);
  solve(G, spare, pivot, z);
}

void least_norm(double *A, Int n, double *b, double *room, Int *order, double *x) {
  for (Int k = 0; k < n; k++) order[k] = k;
  Int rank = reduce(A, n, order, b), spare = n - rank;
  back(A, n, rank, b);
  double *W = A + rank * n, *z = room + spare * spare;
  for (Int j = 0; j < spare; j++) back(A, n, rank, W + j * n);
  if (spare) spare_part(W, n, rank, b, room, order + n);
  for (Int k = 0; k < rank; k++) {
    double sum = b[k];
    for (Int j = 0; j < spare; j++) sum -= W[j * n + k] * z[j];
    x[order[k]] = sum;
  }
  for (Int j = 0; j < spare; j++) x[order[rank + j]] = z[j];
}
