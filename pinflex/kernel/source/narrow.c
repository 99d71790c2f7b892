/* Matrices whose entries lie near the diagonal once the unknowns are in order, as those of loops in
   a row: the order of Cuthill and McKee (1969), from an end of the graph of the entries breadth
   first, neighbours of few entries before others; then LU with row pivots within the band:

     rows k ... k + band of column k hold its multipliers, rows k - 2 band ... k its U */
#include "lu.h"

enum { OFTEN = 4 }; /* a band pays where so many of them fit into the matrix */

static int joined(const double *A, Int n, Int i, Int j) { return A[j * n + i] != 0.0; }

/* Unknowns that hang together with a first one, breadth first, from order[from] on; where they end.
   place: -1 for those that are not in order yet. */
static Int spread(const double *A, Int n, Int first, Int from, const Int *degree, Int *order,
                  Int *place) {
  Int end = from;
  order[end] = first, place[first] = end++;
  for (Int at = from; at < end; at++) {
    Int begin = end;
    for (Int i = 0; i < n; i++) {
      if (place[i] >= 0 || !joined(A, n, i, order[at])) continue;
      Int k = end++;
      for (; k > begin && degree[order[k - 1]] > degree[i]; k--) order[k] = order[k - 1];
      order[k] = i, place[i] = from;
    }
    for (Int k = begin; k < end; k++) place[order[k]] = k;
  }
  return end;
}

Int narrow_order(const double *A, Int n, Int *order, Int *room) {
  Int *place = room, *degree = room + n, band = 0, entries = 0;
  for (Int j = 0; j < n; j++) {
    place[j] = -1, degree[j] = 0;
    for (Int i = 0; i < n; i++) degree[j] += joined(A, n, i, j);
    entries += degree[j];
  }
  if (OFTEN * (entries - n) > 2 * n * n) return n; /* no order makes so many a narrow band */
  for (Int from = 0, end; from < n; from = end) {
    Int first = -1;
    for (Int i = 0; i < n; i++)
      if (place[i] < 0 && (first < 0 || degree[i] < degree[first])) first = i;
    end = spread(A, n, first, from, degree, order, place);
    Int last = order[end - 1]; /* farthest from the first: an end of the graph */
    for (Int k = from; k < end; k++) place[order[k]] = -1;
    end = spread(A, n, last, from, degree, order, place);
  }
  for (Int j = 0; j < n; j++)
    for (Int i = 0; i < n; i++) {
      Int away = place[i] > place[j] ? place[i] - place[j] : place[j] - place[i];
      if (away > band && joined(A, n, i, j)) band = away;
    }
  return band;
}

int is_narrow(Int n, Int band) { return OFTEN * band < n; }

int narrow_factors(const double *A, Int n, const Int *order, Int band, double *B, Int *pivot) {
  Int width = 3 * band + 1, reach = 0;
  for (Int j = 0; j < n; j++) {
    double *to = B + j * width + 2 * band - j;
    for (Int i = j - 2 * band; i <= j + band; i++) to[i] = 0.0;
    for (Int i = j > band ? j - band : 0; i <= j + band && i < n; i++)
      to[i] = A[order[j] * n + order[i]];
  }
  for (Int k = 0; k < n; k++) {
    double *u = B + k * width + 2 * band - k, most = -1.0; /* u[i]: row i */
    Int last = k + band < n ? k + band : n - 1, best = k;
    for (Int i = k; i <= last; i++)
      if (fabs(u[i]) > most) most = fabs(u[i]), best = i;
    if (!(most > 0.0) || !(most < 1e300)) return 0;
    pivot[k] = best;
    Int far = best + band < n ? best + band : n - 1;
    if (far > reach) reach = far;
    double x = u[best], inverse = 1.0 / x;
    u[best] = u[k], u[k] = x;
    for (Int i = k + 1; i <= last; i++) u[i] *= inverse;
    for (Int c = k + 1; c <= reach; c++) {
      double *w = B + c * width + 2 * band - c, y = w[best];
      w[best] = w[k], w[k] = y;
      if (y != 0.0)
        for (Int i = k + 1; i <= last; i++) w[i] -= u[i] * y;
    }
  }
  return 1;
}

/* Largest over smallest pivot. */
double narrow_spread(const double *B, Int n, Int band) {
  double least = INFINITY, most = 0.0;
  for (Int k = 0; k < n; k++) {
    double x = fabs(B[k * (3 * band + 1) + 2 * band]);
    least = fmin(least, x), most = fmax(most, x);
  }
  return most / least;
}

void narrow_solve(const double *B, Int n, const Int *order, Int band, const Int *pivot, double *room,
                  double *x) {
  Int width = 3 * band + 1;
  for (Int k = 0; k < n; k++) room[k] = x[order[k]];
  for (Int k = 0; k < n; k++) {
    const double *l = B + k * width + 2 * band - k;
    double y = room[pivot[k]];
    room[pivot[k]] = room[k], room[k] = y;
    for (Int i = k + 1; i <= k + band && i < n; i++) room[i] -= l[i] * y;
  }
  for (Int k = n - 1; k >= 0; k--) {
    const double *u = B + k * width + 2 * band - k;
    double y = room[k] /= u[k];
    for (Int i = k > 2 * band ? k - 2 * band : 0; i < k; i++) room[i] -= u[i] * y;
  }
  for (Int k = 0; k < n; k++) x[order[k]] = room[k];
}
