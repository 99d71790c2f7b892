/* Newton's matrices of a tree without loops: each block of coordinates is eliminated by itself, from the
   tips to the base, so that a chain costs as much as it is long.

   Rows i of a block see the columns c of those before it as  F_i . R_c,  and these see them as
   L_c . G_i.  With S, U, Z, V of c where its block ends, and a, v, q, b of i (path.c), and mu an
   eigenvalue of A^-1,

     R = (mu^2 S + h mu U + h^2 Z,  h mu S_turn + h^2 V)    F = (a, b)
     L = S                                                  G = mu^2 a + h mu v + h^2 q

   With z = sum R_c x_c of the blocks before a block, w = sum G_i x_i of it and of all behind it, and k
   the blocks that follow it,

     D x + F z + sum L_k' w_k = f     z_k = z + R_k x     w = G x + sum w_k

   so that, from the tips on, w = T z + u:

     E = D + sum L_k' T_k R_k   H = F + sum L_k' T_k   Q = G + sum T_k R_k   T = sum T_k - Q E^-1 H

   Source: Featherstone (2008), chapter 7, its articulated bodies as blocks of coordinates. */
#include "chain.h"

enum { BEFORE = 9, BEHIND = 6, NUMBERS = 21 }; /* of z and w; of a row or column, path.c */
enum { OF_U = 6, OF_Z = 12, OF_V = 18 };

typedef struct { double re, im; } Complex;

/* A block: its n free rows from `first` on, their numbers; what its columns need of those before, (columns,
   21); how `before` columns of the block before move it, (21, before); its factors. */
typedef struct {
  Int n, first, columns, before, above, from;
  const Int *row;
  const double *need, *moved;
  Complex *E, *X, *Q, *T, *u, *z; /* (n, n), E^-1 H (n, 9), (6, n), (6, 9), (6,), (9,) */
  Int *pivot;
} Block;

/* The eigenvalue and its square, times the powers of h that stand with them. */
typedef struct { Complex square, single; double twice; } Weights;

static Weights weights(const Stages *st, Int e) {
  double x = st->value[2 * e], y = st->value[2 * e + 1], h = st->joined_h;
  return (Weights){{x * x - y * y, 2 * x * y}, {h * x, h * y}, h * h};
}

/* mu^2 a + h mu v + h^2 q */
static Complex of(const Weights *w, double a, double v, double q) {
  return (Complex){w->square.re * a + w->single.re * v + w->twice * q,
                   w->square.im * a + w->single.im * v};
}

static void add(Complex *to, Complex a, Complex b) {
  to->re += a.re * b.re - a.im * b.im, to->im += a.re * b.im + a.im * b.re;
}

static void take(Complex *from, Complex a, Complex b) {
  from->re -= a.re * b.re - a.im * b.im, from->im -= a.re * b.im + a.im * b.re;
}

static void scale_add(Complex *to, double a, Complex b) { to->re += a * b.re, to->im += a * b.im; }

/* First free row that is `row` of the velocities or behind it. */
static Int free_from(const Stages *st, Int row) {
  Int low = 0, high = st->free;
  while (low < high) {
    Int middle = (low + high) / 2;
    if (st->free_at[middle] < row) low = middle + 1;
    else high = middle;
  }
  return low;
}

static Block block_of(const Tables *t, const Stages *st, Int e, Int b) {
  Int from = t->block_at[b], first = free_from(st, from), above = t->block_above[b];
  Int n = free_from(st, t->block_at[b + 1]) - first, columns = columns_of(t, b);
  Complex *at = (Complex *)(st->lu + 2 * e * st->free * st->free) + t->chain_at[b];
  Block x = {.n = n, .first = first, .columns = columns, .above = above, .from = from};
  x.row = st->free_at + first, x.pivot = st->pivot + e * st->free + first;
  x.need = st->joined + t->joined_at[b], x.moved = x.need + NUMBERS * columns;
  x.before = above < 0 ? 0 : columns_of(t, above);
  x.E = at, x.X = x.E + n * n, x.Q = x.X + BEFORE * n, x.T = x.Q + BEHIND * n;
  x.u = x.T + BEHIND * BEFORE, x.z = x.u + BEHIND;
  return x;
}

/* Column c of R of block k, whose coordinate has number `row` in the block before. */
static void moves(const Block *k, const Weights *w, Int row, Complex *R) {
  const double *m = k->moved + row;
  Int n = k->before;
  for (int d = 0; d < 6; d++) R[d] = of(w, m[d * n], m[(OF_U + d) * n], m[(OF_Z + d) * n]);
  for (int d = 0; d < 3; d++) R[6 + d] = of(w, 0.0, m[(3 + d) * n], m[(OF_V + d) * n]);
}

/* D, F and G of a block, added to what those behind it have left. */
static void own(const Tables *t, const Weights *w, const double *M, Block *b) {
  Int nv = t->nv, square = nv * nv, n = b->n;
  for (Int i = 0; i < n; i++) {
    const double *need = b->need + NUMBERS * (b->row[i] - b->from);
    for (Int j = 0; j < n; j++) {
      const double *at = M + b->row[i] * nv + b->row[j];
      Complex x = of(w, at[0], at[square], at[2 * square]);
      b->E[i * n + j].re += x.re, b->E[i * n + j].im += x.im;
    }
    for (int d = 0; d < 6; d++) {
      Complex g = of(w, need[d], need[OF_U + d], need[OF_Z + d]);
      b->X[i * BEFORE + d].re += need[d];
      b->Q[d * n + i].re += g.re, b->Q[d * n + i].im += g.im;
    }
    for (int d = 0; d < 3; d++) b->X[i * BEFORE + 6 + d].re += need[OF_V + d];
  }
}

/* E as its factors, with pivots. */
static int factor_block(Block *b) {
  Int n = b->n;
  Complex *E = b->E;
  for (Int k = 0; k < n; k++) {
    double most = -1.0;
    for (Int i = k; i < n; i++) {
      double size = fabs(E[i * n + k].re) + fabs(E[i * n + k].im);
      if (size > most) most = size, b->pivot[k] = i;
    }
    if (!(most > 0.0) || !(most < 1e300)) return 0;
    for (Int j = k; j < n; j++) { /* multipliers stay, see solve_block */
      Complex x = E[k * n + j];
      E[k * n + j] = E[b->pivot[k] * n + j], E[b->pivot[k] * n + j] = x;
    }
    Complex p = E[k * n + k];
    double size = 1.0 / (p.re * p.re + p.im * p.im);
    E[k * n + k] = (Complex){p.re * size, -p.im * size}; /* its inverse */
    for (Int i = k + 1; i < n; i++) {
      Complex l = {0.0, 0.0};
      add(&l, E[i * n + k], E[k * n + k]);
      E[i * n + k] = l;
      for (Int j = k + 1; j < n; j++) take(E + i * n + j, l, E[k * n + j]);
    }
  }
  return 1;
}

/* x, (n, columns), of E x = b in place */
static void solve_block(const Block *b, Int columns, Complex *x) {
  Int n = b->n;
  for (Int k = 0; k < n; k++)
    for (Int c = 0; c < columns; c++) {
      Complex *at = x + k * columns + c, *other = x + b->pivot[k] * columns + c, y = *at;
      *at = *other, *other = y;
      for (Int i = k + 1; i < n; i++) take(x + i * columns + c, b->E[i * n + k], *at);
    }
  for (Int k = n - 1; k >= 0; k--)
    for (Int c = 0; c < columns; c++) {
      Complex *at = x + k * columns + c, y = {0.0, 0.0};
      add(&y, *at, b->E[k * n + k]);
      *at = y;
      for (Int i = 0; i < k; i++) take(x + i * columns + c, b->E[i * n + k], y);
    }
}

/* What block k leaves to the one before it: T R to Q, L' T R to E, L' T to H, T to T. */
static void leave(const Block *k, const Weights *w, Block *to) {
  Int n = to->n, before = k->before;
  for (Int j = 0; j < n; j++) {
    Complex R[BEFORE];
    const double *L = k->moved + to->row[j] - to->from;
    moves(k, w, to->row[j] - to->from, R);
    for (int d = 0; d < BEHIND; d++) {
      Complex sum = {0.0, 0.0};
      for (int c = 0; c < BEFORE; c++) {
        add(&sum, k->T[d * BEFORE + c], R[c]);
        scale_add(to->X + j * BEFORE + c, L[d * before], k->T[d * BEFORE + c]);
      }
      to->Q[d * n + j].re += sum.re, to->Q[d * n + j].im += sum.im;
      for (Int i = 0; i < n; i++)
        scale_add(to->E + i * n + j, k->moved[d * before + to->row[i] - to->from], sum);
    }
  }
  for (Int i = 0; i < BEHIND * BEFORE; i++) scale_add(to->T + i, 1.0, k->T[i]);
}

int chain_factors(const Tables *t, const Stages *st, Int e, const double *M) {
  Weights w = weights(st, e);
  Complex *all = (Complex *)(st->lu + 2 * e * st->free * st->free);
  for (Int i = 0; i < t->chain_at[t->blocks]; i++) all[i] = (Complex){0.0, 0.0};
  for (Int i = t->blocks - 1; i >= 0; i--) {
    Block b = block_of(t, st, e, t->block_order[i]);
    own(t, &w, M, &b);
    if (!factor_block(&b)) return 0;
    solve_block(&b, BEFORE, b.X);
    for (Int k = 0; k < b.n; k++)
      for (int d = 0; d < BEHIND; d++)
        for (int c = 0; c < BEFORE; c++)
          take(b.T + d * BEFORE + c, b.Q[d * b.n + k], b.X[k * BEFORE + c]);
    if (b.above < 0) continue;
    Block up = block_of(t, st, e, b.above);
    leave(&b, &w, &up);
  }
  return 1;
}

/* From the tips on: E^-1 (f - sum L' u), and u = sum u_k + Q of that. */
static void inward_pass(const Tables *t, const Stages *st, Int e, Complex *f) {
  for (Int i = 0; i < t->blocks; i++) {
    Block b = block_of(t, st, e, i);
    for (int d = 0; d < BEHIND; d++) b.u[d] = (Complex){0.0, 0.0};
  }
  for (Int i = t->blocks - 1; i >= 0; i--) {
    Block b = block_of(t, st, e, t->block_order[i]);
    Complex *x = f + b.first;
    solve_block(&b, 1, x);
    for (int d = 0; d < BEHIND; d++)
      for (Int k = 0; k < b.n; k++) add(b.u + d, b.Q[d * b.n + k], x[k]);
    if (b.above < 0) continue;
    Block up = block_of(t, st, e, b.above);
    for (int d = 0; d < BEHIND; d++) {
      for (Int k = 0; k < up.n; k++)
        scale_add(f + up.first + k, -b.moved[d * b.before + up.row[k] - up.from], b.u[d]);
      scale_add(up.u + d, 1.0, b.u[d]);
    }
  }
}

/* From the base on: x less E^-1 H z, and z of the blocks that follow. */
static void outward_pass(const Tables *t, const Stages *st, Int e, Complex *x) {
  Weights w = weights(st, e);
  for (Int i = 0; i < t->blocks; i++) {
    Block b = block_of(t, st, e, t->block_order[i]);
    for (int c = 0; c < BEFORE; c++) b.z[c] = (Complex){0.0, 0.0};
    if (b.above < 0) continue;
    Block up = block_of(t, st, e, b.above);
    for (int c = 0; c < BEFORE; c++) b.z[c] = up.z[c];
    for (Int k = 0; k < up.n; k++) {
      Complex R[BEFORE];
      moves(&b, &w, up.row[k] - up.from, R);
      for (int c = 0; c < BEFORE; c++) add(b.z + c, R[c], x[up.first + k]);
    }
    for (Int k = 0; k < b.n; k++)
      for (int c = 0; c < BEFORE; c++) take(x + b.first + k, b.X[k * BEFORE + c], b.z[c]);
  }
}

void chain_solve(const Tables *t, const Stages *st, Int e, double *x, double *y) {
  Int n = st->free;
  Complex *both = (Complex *)(st->lu + 2 * e * n * n) + t->chain_at[t->blocks];
  for (Int i = 0; i < n; i++) both[i] = (Complex){x[i], y[i]};
  inward_pass(t, st, e, both);
  outward_pass(t, st, e, both);
  for (Int i = 0; i < n; i++) x[i] = both[i].re, y[i] = both[i].im;
}

void chain_product(const Tables *t, const Stages *st, const double *M, const double *a, const double *v,
                   const double *q, double *out) {
  Int nv = t->nv, square = nv * nv;
  for (Int i = 0; i < t->blocks; i++) { /* z, from the base on */
    Block b = block_of(t, st, 0, t->block_order[i]);
    Block up = b.above < 0 ? b : block_of(t, st, 0, b.above);
    Int n = b.before;
    for (int c = 0; c < BEFORE; c++) b.z[c].re = b.above < 0 ? 0.0 : up.z[c].re, b.u[c % BEHIND].re = 0.0;
    for (Int k = 0; k < n; k++) {
      const double *m = b.moved + k;
      double x = a[up.from + k], dx = v[up.from + k], ddx = q[up.from + k];
      for (int d = 0; d < 6; d++) b.z[d].re += m[d * n] * x + m[(OF_U + d) * n] * dx + m[(OF_Z + d) * n] * ddx;
      for (int d = 0; d < 3; d++) b.z[6 + d].re += m[(3 + d) * n] * dx + m[(OF_V + d) * n] * ddx;
    }
    for (Int k = b.from; k < b.from + b.columns; k++) {
      const double *need = b.need + NUMBERS * (k - b.from), *row = M + k * nv;
      out[k] = 0.0;
      for (Int j = b.from; j < b.from + b.columns; j++)
        out[k] += row[j] * a[j] + row[square + j] * v[j] + row[2 * square + j] * q[j];
      for (int d = 0; d < 6; d++) out[k] += need[d] * b.z[d].re;
      for (int d = 0; d < 3; d++) out[k] += need[OF_V + d] * b.z[6 + d].re;
    }
  }
  for (Int i = t->blocks - 1; i >= 0; i--) { /* w, from the tips on */
    Block b = block_of(t, st, 0, t->block_order[i]);
    for (Int k = 0; k < b.columns; k++) {
      const double *need = b.need + NUMBERS * k;
      Int j = b.from + k;
      for (int d = 0; d < 6; d++)
        b.u[d].re += need[d] * a[j] + need[OF_U + d] * v[j] + need[OF_Z + d] * q[j];
    }
    if (b.above < 0) continue;
    Block up = block_of(t, st, 0, b.above);
    for (int d = 0; d < BEHIND; d++) {
      for (Int k = 0; k < b.before; k++) out[up.from + k] += b.moved[d * b.before + k] * b.u[d].re;
      up.u[d].re += b.u[d].re;
    }
  }
}

double *chain_room(const Tables *t, const Stages *st) { return st->lu + 2 * t->chain_at[t->blocks]; }
