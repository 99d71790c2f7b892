/* Newton's equations of a collocation step. For each eigenvalue mu of A^-1, with dz = A^2 da,

     [ mu^2 M + h mu C + h^2 K    J' ] [  dz  ]     [ r      ]
     [ J                          0  ] [ -dlam] = - [ c/h^2  ]

   Eigenvalues stand side by side, as states do in a residual: an entry is a pair of lanes, and LANES
   matrices are factored by one order of pivots. A real eigenvalue has imaginary parts of zero, and
   lanes that are left over repeat the last one.

   Groups of unknowns are factored as dense blocks, and what they do not touch is left out
   (sparsity.c). Coordinates need no pivots of other groups: with mu in the right half plane the real
   part of the matrix over mu is positive definite, but for forces that drive. Where a pivot is small
   nevertheless, all are one group. Factors lie column by column, inverse pivots on the diagonal. */
#include "chain.h"
#include "march.h"
#include "sparsity.h"
#include <stddef.h>
#include <string.h>

static const double SMALL = 1e-6; /* of its column: a pivot that costs digits */

typedef struct { Lane re, im; } Pair;

static Int size_of(const Tables *t, const Stages *st) { return st->free + t->closures; }
static Pair *matrix_of(const Stages *st, Int set, Int n) { return (Pair *)st->lu + set * n * n; }

/* A complex number of each eigenvalue of a set, every `stride` in `from`. */
static Pair each(const Stages *st, Int set, const double *from, Int stride) {
  Pair x;
  for (Int l = 0; l < LANES; l++) {
    Int e = LANES * set + l, last = st->values - 1;
    const double *at = from + 2 * stride * (e < last ? e : last);
    x.re[l] = at[0], x.im[l] = at[1];
  }
  return x;
}

static Pair product(Pair a, Pair b) {
  return (Pair){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

static void take(Pair *u, Pair a, Pair p) {
  u->re -= a.re * p.re, u->im -= a.re * p.im;
  u->re += a.im * p.im, u->im -= a.im * p.re;
}

/* u -= a p, n entries; and u -= a p + b q: what is read and written of u is halved. */
static void take_one(Int n, const Pair *restrict a, Pair p, Pair *restrict u) {
  for (Int i = 0; i < n; i++) take(u + i, a[i], p);
}

static void take_two(Int n, const Pair *restrict a, const Pair *restrict b, Pair p, Pair q,
                     Pair *restrict u) {
  for (Int i = 0; i < n; i++) {
    Pair x = u[i];
    take(&x, a[i], p), take(&x, b[i], q);
    u[i] = x;
  }
}

static Lane largest(Lane most, Pair x) {
  const LaneBits size = {INT64_MAX, INT64_MAX, INT64_MAX, INT64_MAX}; /* all but the sign */
  Lane y = (Lane)((LaneBits)x.re & size) + (Lane)((LaneBits)x.im & size);
  LaneBits more = y > most;
  return (Lane)((more & (LaneBits)y) | (~more & (LaneBits)most));
}

static double least(Lane x) {
  double y = x[0];
  for (int l = 1; l < LANES; l++) y = x[l] < y ? x[l] : y;
  return y;
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
static void swap_rows(Pair *A, Int n, Int first, const Group *g, Int i, Int j) {
  Int at[2 * SPANS + 2], ends = rows_of(g, first, at);
  for (Int c = 0; c < ends; c += 2)
    for (Int k = at[c]; k < at[c + 1]; k++) {
      Pair x = A[k * n + i];
      A[k * n + i] = A[k * n + j], A[k * n + j] = x;
    }
}

/* Find the pivot of column k in its group, the row that is next to the largest entry in all matrices,
   bring it up, and divide what is below; 0 where it is none. */
static int eliminate(Pair *A, Int n, Int k, Int first, const Group *g, Int *pivot) {
  Pair *a = A + k * n;
  Lane most = lane(0.0), below = lane(0.0);
  double best = 0.0;
  for (Int i = k; i < g->end; i++) most = largest(most, a[i]);
  for (Int p = 0; p < g->spans; p++)
    for (Int i = g->at[2 * p]; i < g->at[2 * p + 1]; i++) below = largest(below, a[i]);
  pivot[k] = k;
  for (Int i = k; i < g->end; i++) {
    double share = least(largest(lane(0.0), a[i]) / most);
    if (share > best) best = share, pivot[k] = i;
  }
  if (pivot[k] != k) swap_rows(A, n, first, g, k, pivot[k]);
  Lane found = largest(lane(0.0), a[k]);
  for (int l = 0; l < LANES; l++)
    if (!(found[l] > SMALL * below[l]) || !(found[l] < 1e300)) return 0;
  Lane d = 1.0 / (a[k].re * a[k].re + a[k].im * a[k].im);
  Pair inverse = {a[k].re * d, -a[k].im * d};
  a[k] = inverse;
  Int at[2 * SPANS + 2], ends = rows_of(g, k + 1, at);
  for (Int r = 0; r < ends; r += 2)
    for (Int i = at[r]; i < at[r + 1]; i++) a[i] = product(a[i], inverse);
  return 1;
}

/* Columns k and k + 1, eliminated, taken off the columns of a group and of its spans. */
static void take_off(Pair *A, Int n, Int k, const Group *g) {
  const Pair *a = A + k * n, *b = a + n;
  Int at[2 * SPANS + 2], ends = rows_of(g, k + 2, at);
  for (Int s = 0; s < ends; s += 2)
    for (Int j = at[s]; j < at[s + 1]; j++) {
      Pair *u = A + j * n;
      take(u + k + 1, a[k + 1], u[k]);
      for (Int r = 0; r < ends; r += 2)
        take_two(at[r + 1] - at[r], a + at[r], b + at[r], u[k], u[k + 1], u + at[r]);
    }
}

/* Column k alone, eliminated, taken off columns `first` to `end`. */
static void take_off_one(Pair *A, Int n, Int k, Int first, Int end, const Group *g) {
  const Pair *a = A + k * n;
  Int at[2 * SPANS + 2], ends = rows_of(g, k + 1, at);
  for (Pair *u = A + first * n; u < A + end * n; u += n)
    for (Int r = 0; r < ends; r += 2) take_one(at[r + 1] - at[r], a + at[r], u[k], u + at[r]);
}

/* LU of a set, group by group, two columns at a time, with pivots of the same group; 0 where one is
   none. */
static int decompose(Pair *A, Int n, const Sparsity *s, Int *pivot) {
  const Group *g = s->group;
  for (Int first = 0; first < n; first = g++->end)
    for (Int k = first; k < g->end; k += 2) {
      if (!eliminate(A, n, k, first, g, pivot)) return 0;
      if (k + 1 == g->end) {
        for (Int p = 0; p < g->spans; p++)
          take_off_one(A, n, k, g->at[2 * p], g->at[2 * p + 1], g);
        break;
      }
      take_off_one(A, n, k, k + 1, k + 2, g);
      if (!eliminate(A, n, k + 1, first, g, pivot)) return 0;
      take_off(A, n, k, g);
    }
  return 1;
}

/* What multipliers of a group take off the unknowns below, two columns at a time. */
static void forward(const Pair *A, Int n, Int first, const Group *g, Pair *x) {
  Int at[2 * SPANS + 2];
  for (Int k = first; k < g->end; k += 2) {
    const Pair *a = A + k * n;
    int two = k + 1 < g->end;
    if (two) take(x + k + 1, a[k + 1], x[k]);
    for (Int r = 0, ends = rows_of(g, k + 1 + two, at); r < ends; r += 2) {
      Int i = at[r], rows = at[r + 1] - i;
      if (two) take_two(rows, a + i, a + n + i, x[k], x[k + 1], x + i);
      else take_one(rows, a + i, x[k], x + i);
    }
  }
}

static void substitute(const Pair *A, Int n, const Sparsity *s, const Int *pivot, Pair *x) {
  const Group *g = s->group;
  for (Int first = 0; first < n; first = g++->end) {
    for (Int k = first; k < g->end; k++) {
      Pair y = x[pivot[k]];
      x[pivot[k]] = x[k], x[k] = y;
    }
    forward(A, n, first, g, x);
  }
  for (Int k = n - 1; k >= 0; k -= 2) {
    const Pair *a = A + k * n, *b = a - n;
    x[k] = product(x[k], a[k]);
    if (k == 0) break;
    take(x + k - 1, a[k - 1], x[k]);
    x[k - 1] = product(x[k - 1], b[k - 1]);
    Int i = s->top[k];
    if (i < k - 1) take_two(k - 1 - i, b + i, a + i, x[k - 1], x[k], x + i);
  }
}

/* Weights of M, C and K in the matrices of a set. */
typedef struct { Pair M, C; Lane K; } Weights;

static Pair entry(const Stages *st, const Weights *w, Int at) {
  double M = st->M[at], C = st->C[at];
  return (Pair){w->M.re * M + w->C.re * C + w->K * st->K[at], w->M.im * M + w->C.im * C};
}

/* The matrices of a set, unknowns in order: entries that links know. */
static void assemble(const Tables *t, const Stages *st, Int set, const Sparsity *s, Pair *A) {
  Int free = st->free, n = size_of(t, st), all = *s->groups <= DENSE;
  Pair mu = each(st, set, st->value, 1);
  Weights w = {product(mu, mu), {st->h * mu.re, st->h * mu.im}, lane(st->h * st->h)};
  const Group *g = s->group;
  for (Int j = 0; j < n; j++) {
    if (j == g->end) g++;
    Pair *u = A + j * n;
    memset(u + s->top[j], 0, (g->end - s->top[j]) * sizeof(Pair));
    for (Int p = 0; p < g->spans; p++)
      memset(u + g->at[2 * p], 0, (g->at[2 * p + 1] - g->at[2 * p]) * sizeof(Pair));
    Int column = s->order[j];
    const uint64_t *linked = s->links + column * words_of(n);
    for (Int k = all ? 0 : next_of(linked, 0, n); k < n; k = all ? k + 1 : next_of(linked, k + 1, n)) {
      Pair *to = u + s->place[k];
      if (k < free && column < free) *to = entry(st, &w, k * free + column);
      else if (k < free) to->re = lane(st->J[(column - free) * free + k]);
      else if (column < free) to->re = lane(st->J[(k - free) * free + column]);
    }
  }
}

static int factored(const Tables *t, const Stages *st) {
  Int n = size_of(t, st);
  Sparsity s = sparsity(t, st);
  for (Int set = 0; set < lanes_of(st->values); set++) {
    Pair *A = matrix_of(st, set, n);
    assemble(t, st, set, &s, A);
    if (!decompose(A, n, &s, st->pivot + set * n)) return 0;
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
static void project_stages(const Tables *t, const Stages *st, Int set, const Int *order, Pair *x) {
  Int n = st->free, rows = t->closures, size = n + rows;
  double inverse = 1.0 / (st->h * st->h);
  memset(x, 0, size * sizeof(Pair));
  for (Int k = 0; k < st->s; k++) {
    Pair p = each(st, set, st->forward + 2 * k, st->s);
    for (Int i = 0; i < size; i++) {
      Int j = order[i];
      double r = j < n ? st->r[k * t->nv + st->free_at[j]] : inverse * st->open[k * rows + j - n];
      x[i].re -= p.re * r, x[i].im -= p.im * r;
    }
  }
}

/* Those of a chain, one eigenvalue after the other; behind x there is room for one. */
static void solve_chain(const Tables *t, const Stages *st, Int set, Pair *x, double *room) {
  Int n = st->free;
  for (Int l = 0; l < LANES && LANES * set + l < st->values; l++) {
    for (Int i = 0; i < n; i++) room[i] = x[i].re[l], room[n + i] = x[i].im[l];
    chain_solve(t, st, LANES * set + l, room, room + n);
    for (Int i = 0; i < n; i++) x[i].re[l] = room[i], x[i].im[l] = room[n + i];
  }
}

/* What a set adds to dlam, and to dz in `change`. */
static void add_stages(const Tables *t, const Stages *st, Int set, const Int *order, const Pair *x) {
  Int n = st->free, rows = t->closures, size = n + rows, kept = st->values - LANES * set;
  for (Int k = 0; k < st->s; k++) {
    Pair p = each(st, set, st->back + 2 * k * st->values, 1);
    for (Int l = kept; l < LANES; l++) p.re[l] = p.im[l] = 0.0;
    for (Int i = 0; i < size; i++) {
      Lane z = p.re * x[i].re - p.im * x[i].im;
      double sum = (z[0] + z[1]) + (z[2] + z[3]);
      Int j = order[i];
      if (j < n) st->change[k * t->nv + st->free_at[j]] += sum;
      else st->dlam[k * rows + j - n] -= sum;
    }
  }
}

/* dlam, and dz in `change`, from the residuals. */
EXPORT void pinflex_solve(const Tables *t, const Stages *st) {
  Int n = st->free, size = size_of(t, st), sets = lanes_of(st->values);
  Sparsity known = sparsity(t, st);
  for (Int k = 0; k < st->s; k++)
    for (Int j = 0; j < n; j++) st->change[k * t->nv + st->free_at[j]] = 0.0;
  memset(st->dlam, 0, st->s * t->closures * sizeof(double));
  for (Int set = 0; set < sets; set++) {
    Pair *x = (Pair *)st->part;
    project_stages(t, st, set, known.order, x);
    if (st->joined) solve_chain(t, st, set, x, (double *)(x + size));
    else substitute(matrix_of(st, set, size), size, &known, st->pivot + set * size, x);
    add_stages(t, st, set, known.order, x);
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
