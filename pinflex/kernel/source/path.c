/* Motions of the nodes by the coordinates on their paths, side by side, and what joints need by them.

   With x_j the rows of the map of the columns j on the path to a node, S, Y, Z, U as in tangent.c, it
   is moved by the coordinates and accelerated by them and their rates as

     S = sum S_j x_j              U = sum U_j x_j + 2 S_j x_j'
     V = sum Y_j x_j + S_j x_j'   Z = sum Z_j x_j + U_j x_j' + S_j x_j''

   A joint i after it needs, by its own coordinates, the wrenches

     a = sum I S_i x_i    v = sum (B S_i + I U_i) x_i + 2 I S_i x_i'    b = sum B' S_i x_i
     q = sum (B Y_i + I Z_i + S_i x f) x_i + (B S_i + I U_i) x_i' + I S_i x_i''

   which are its rows of M, C and K:  a.S, a.U + b.S, a.Z + b.V,  and its columns:  S.a, S.v, S.q.
   Coordinates of a block follow each other, and blocks do along a path. */
#include "tangent.h"

enum { OF_S = 0, OF_U = 6, OF_Z = 12, OF_V = 18, NUMBERS = 21, ROWS = 5 };

static Int columns_of(const Tables *t, Int block) {
  return t->block_at[block + 1] - t->block_at[block];
}

static Int lanes_of(Int n) { return (n + LANES - 1) / LANES; }

/* Lanes of the longest path, and of the widest block. */
static void widths(const Tables *t, Int *deep, Int *wide) {
  *deep = *wide = 0;
  for (Int b = 0; b < t->blocks; b++) {
    Int n = columns_of(t, b), top = lanes_of(t->block_depth[b] + n);
    if (top > *deep) *deep = top;
    if (lanes_of(n) > *wide) *wide = lanes_of(n);
  }
}

/* Lanes of a row: as many as the path to the end of the block takes. */
static Int row_lanes(const Tables *t, Int block) {
  return lanes_of(t->block_depth[block] + columns_of(t, block));
}

Int path_room(const Tables *t) {
  Int deep, wide, rows = 0;
  widths(t, &deep, &wide);
  for (Int b = 0; b < t->blocks; b++) rows += ROWS * columns_of(t, b) * row_lanes(t, b);
  rows += NUMBERS * (deep + wide) + 9 * wide + 3 * LANES * wide * wide;
  return LANES * rows + (t->blocks / 8 + 1) * 8;
}

void path_layout(const Tables *t, double *memory, Path *w) {
  Int rows = 0;
  widths(t, &w->deep, &w->wide);
  w->rows_at = (Int *)memory; /* of each block, and where they end */
  for (Int b = 0; b < t->blocks; b++) {
    w->rows_at[b] = rows;
    rows += ROWS * columns_of(t, b) * row_lanes(t, b);
  }
  w->rows_at[t->blocks] = rows;
  memory += (t->blocks / 8 + 1) * 8;
  w->moved = (Lane *)memory;
  w->need = w->moved + NUMBERS * w->deep;
  w->map = w->need + NUMBERS * w->wide;
  w->own = w->map + 9 * w->wide;
  w->rows = w->own + 3 * LANES * w->wide * w->wide;
}

void begin_paths(const Tables *t, Path *w) {
  w->end = -1;
  memset(w->rows, 0, w->rows_at[t->blocks] * sizeof(Lane));
}

/* out += a x, n numbers */
static void add(Int n, double a, const double *restrict x, double *restrict out) {
  for (Int k = 0; k < n; k++) out[k] += a * x[k];
}

/* From the node before to a node. */
static void go_on(const Tables *t, Tangent *w, Int node) {
  Int block = t->node_block[node], up = t->parent[node], at = t->block_depth[block];
  Int stride = LANES * w->along.deep, end = LANES * row_lanes(t, block);
  double *moved = (double *)w->along.moved;
  if (up < 0 || t->node_block[up] != block)
    for (int d = 0; d < NUMBERS; d++)
      memset(moved + d * stride + at, 0, (end - at) * sizeof(double));
  for (Int i = t->node_v[node]; i < t->node_v[node] + width(t->kind[node]); i++) {
    Int from = t->x_at[i], n = t->x_at[i + 1] - from;
    const double *x = w->x + from, *dx = w->dx + from, *ddx = w->ddx + from;
    const Column *c = w->column + i;
    double *to = moved + at + t->col_first[i] - t->block_at[block];
    for (int d = 0; d < 6; d++, to += stride) {
      double *U = to + OF_U * stride, *Z = to + OF_Z * stride;
      add(n, c->S[d], x, to);
      add(n, c->U[d], x, U), add(n, 2.0 * c->S[d], dx, U);
      add(n, c->Z[d], x, Z), add(n, c->U[d], dx, Z), add(n, c->S[d], ddx, Z);
      if (d < 3) continue;
      double *V = to + (OF_V - 3) * stride;
      add(n, c->Y[d], x, V), add(n, c->S[d], dx, V);
    }
  }
  w->along.end = node;
}

void go_to(const Tables *t, Tangent *w, Int node) {
  if (w->along.end == node) return;
  if (node < 0) {
    w->along.end = node;
    return;
  }
  go_to(t, w, t->parent[node]);
  go_on(t, w, node);
}

void begin_needs(Path *w) { memset(w->need, 0, NUMBERS * w->wide * sizeof(Lane)); }

void add_needs(const Tables *t, Tangent *w, Int i, const Needs *f) {
  Int from = t->x_at[i], n = t->x_at[i + 1] - from, stride = LANES * w->along.wide;
  const double *x = w->x + from, *dx = w->dx + from, *ddx = w->ddx + from;
  double *to = (double *)w->along.need + t->col_first[i] - t->block_at[t->block_of[i]];
  for (int d = 0; d < 6; d++, to += stride) {
    double *v = to + OF_U * stride, *q = to + OF_Z * stride;
    add(n, f->a[d], x, to);
    add(n, f->v[d], x, v), add(n, 2.0 * f->a[d], dx, v);
    add(n, f->q[d], x, q), add(n, f->v[d], dx, q), add(n, f->a[d], ddx, q);
    if (d < 3) add(n, f->b[d], x, to + OF_V * stride);
  }
}

static Lane sum_six(const double *f, const Lane *x, Int deep) {
  return f[0] * x[0] + f[1] * x[deep] + f[2] * x[2 * deep] + f[3] * x[3 * deep] + f[4] * x[4 * deep]
         + f[5] * x[5 * deep];
}

static Lane sum_three(const double *f, const Lane *x, Int deep) {
  return f[0] * x[0] + f[1] * x[deep] + f[2] * x[2 * deep];
}

void meet(const Tables *t, Path *w, Int block, Int before) {
  Int n = columns_of(t, block), length = row_lanes(t, block), deep = w->deep;
  Int inside = before >= 0 && t->node_block[before] == block;
  Int used = inside ? length : lanes_of(t->block_depth[block]);
  for (Int k = 0; k < n; k++) {
    Lane *M = w->rows + w->rows_at[block] + ROWS * length * k, *C = M + length, *K = C + length,
         *by_v = K + length, *by_q = by_v + length;
    double f[NUMBERS], most = 0.0;
    for (int d = 0; d < NUMBERS; d++) {
      f[d] = ((const double *)(w->need + d * w->wide))[k];
      most += fabs(f[d]);
    }
    if (most == 0.0) continue;
    for (Int c = 0; c < used; c++) {
      const Lane *S = w->moved + c;
      M[c] += sum_six(f, S, deep);
      C[c] += sum_six(f, S + OF_U * deep, deep) + sum_three(f + OF_V, S + 3 * deep, deep);
      K[c] += sum_six(f, S + OF_Z * deep, deep) + sum_three(f + OF_V, S + OF_V * deep, deep);
      by_v[c] += sum_six(f + OF_U, S, deep);
      by_q[c] += sum_six(f + OF_Z, S, deep);
    }
  }
}

/* Rows and columns of one block against those of one on its path. */
static void put(const Tables *t, const Path *w, Int block, Int above, double *M, double *C,
                double *K) {
  Int nv = t->nv, n = columns_of(t, above), to = t->block_at[above];
  Int stride = LANES * row_lanes(t, block);
  for (Int k = 0; k < columns_of(t, block); k++) {
    Int row = t->block_at[block] + k;
    const double *m = (const double *)(w->rows + w->rows_at[block]) + ROWS * stride * k
                      + t->block_depth[above];
    for (Int j = 0; j < n; j++) {
      Int here = row * nv + to + j, there = (to + j) * nv + row;
      M[here] += m[j], C[here] += m[stride + j], K[here] += m[2 * stride + j];
      M[there] += m[j], C[there] += m[3 * stride + j], K[there] += m[4 * stride + j];
    }
  }
}

void put_paths(const Tables *t, const Path *w, double *M, double *C, double *K) {
  for (Int b = 0; b < t->blocks; b++)
    for (Int above = b; above >= 0; above = t->block_above[above]) put(t, w, b, above, M, C, K);
}
