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

enum { OF_S = 0, OF_U = 6, OF_Z = 12, OF_V = 18, NUMBERS = 21, ROWS = 5, OWN = 3 };

/* Lanes of the longest path, and of the widest block. */
static void widths(const Tables *t, Int *deep, Int *wide) {
  *deep = *wide = 0;
  for (Int b = 0; b < t->blocks; b++) {
    Int n = lanes_of(columns_of(t, b)), top = lanes_of(t->block_depth[b] + LANES * n);
    if (top > *deep) *deep = top;
    if (n > *wide) *wide = n;
  }
}

/* Lanes of a row: as many as the path to the end of the block takes. */
static Int row_lanes(const Tables *t, Int block) {
  return lanes_of(t->block_depth[block] + columns_of(t, block));
}

/* Lanes of all rows of a block: those of its path, and what its joints need by themselves. */
static Int block_lanes(const Tables *t, Int block) {
  Int n = columns_of(t, block);
  return n * (ROWS * row_lanes(t, block) + OWN * lanes_of(n));
}

Int path_room(const Tables *t) {
  Int deep, wide, rows = 0;
  widths(t, &deep, &wide);
  for (Int b = 0; b < t->blocks; b++) rows += block_lanes(t, b);
  return LANES * (rows + NUMBERS * (deep + wide) + 9 * wide) + (t->blocks / 8 + 1) * 8
         + t->joined_at[t->blocks];
}

void path_layout(const Tables *t, double *memory, Path *w) {
  Int rows = 0;
  widths(t, &w->deep, &w->wide);
  w->rows_at = (Int *)memory; /* of each block, and where they end */
  for (Int b = 0; b < t->blocks; b++) {
    w->rows_at[b] = rows;
    rows += block_lanes(t, b);
  }
  w->rows_at[t->blocks] = rows;
  memory += (t->blocks / 8 + 1) * 8;
  w->moved = (Lane *)memory;
  w->need = w->moved + NUMBERS * w->deep;
  w->map = w->need + NUMBERS * w->wide;
  w->rows = w->map + 9 * w->wide;
  w->joined = (double *)(w->rows + rows);
}

/* First lane of a path that the rows of a block are wanted from. */
static Int first_lane(const Tables *t, const Path *w, Int block) {
  return w->within ? t->block_depth[block] / LANES : 0;
}

/* Where the latter part of a tangent begins: the former has two thirds of what nodes cost, which is half
   of all that a machine of loops costs. */
static Int latter_part(const Tables *t) {
  Int all = 0, block = 0;
  for (Int b = 0; b < t->blocks; b++) all += block_lanes(t, b);
  for (Int sum = 0; block < t->blocks && 3 * sum < 2 * all; block++) sum += block_lanes(t, block);
  return block;
}

void begin_paths(const Tables *t, Path *w, Int part, Int wanted) {
  w->end = -1, w->within = wanted == WITHIN_BLOCKS, w->mass = wanted == MASS;
  w->from = part == LATTER ? latter_part(t) : 0;
  w->to = part == FORMER ? latter_part(t) : t->blocks;
  for (Int b = w->from; b < w->to; b++) {
    Int n = columns_of(t, b), length = row_lanes(t, b), first = first_lane(t, w, b);
    Lane *row = w->rows + w->rows_at[b];
    for (Int k = 0; k < ROWS * n; k++, row += length)
      memset(row + first, 0, (length - first) * sizeof(Lane));
    memset(row, 0, OWN * n * lanes_of(n) * sizeof(Lane));
  }
  memset(w->joined, 0, t->joined_at[t->blocks] * sizeof(double));
}

/* From the node before to a node. Rows of the map end in zeros, which fill their lanes. */
static void go_on(const Tables *t, Tangent *w, Int node) {
  Int block = t->node_block[node], up = t->parent[node], at = t->block_depth[block];
  Int deep = w->along.deep, end = LANES * row_lanes(t, block), n = lanes_of(columns_of(t, block));
  double *moved = (double *)w->along.moved;
  if (up < 0 || t->node_block[up] != block)
    for (int d = 0; d < NUMBERS; d++)
      memset(moved + d * LANES * deep + at, 0, (end - at) * sizeof(double));
  for (Int i = t->node_v[node]; i < t->node_v[node] + width(t->kind[node]); i++)
    for (Int k = 0; k < n; k++) {
      Int from = t->x_at[i] + LANES * k;
      Lane x = *(Lane *)(w->x + from), dx = *(Lane *)(w->dx + from), ddx = *(Lane *)(w->ddx + from);
      LooseLane *to = (LooseLane *)(moved + at) + k;
      const Column *c = w->column + i;
      for (int d = 0; d < 6; d++) to[(OF_S + d) * deep] += c->S[d] * x;
      if (w->along.mass) continue;
      for (int d = 0; d < 6; d++) {
        to[(OF_U + d) * deep] += c->U[d] * x + 2.0 * c->S[d] * dx;
        to[(OF_Z + d) * deep] += c->Z[d] * x + c->U[d] * dx + c->S[d] * ddx;
      }
      for (int d = 0; d < 3; d++) to[(OF_V + d) * deep] += c->Y[3 + d] * x + c->S[3 + d] * dx;
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
  Int n = lanes_of(columns_of(t, t->block_of[i])), wide = w->along.wide;
  for (Int k = 0; k < n; k++) {
    Int from = t->x_at[i] + LANES * k;
    Lane x = *(Lane *)(w->x + from), dx = *(Lane *)(w->dx + from), ddx = *(Lane *)(w->ddx + from);
    Lane *to = w->along.need + k;
    for (int d = 0; d < 6; d++) to[(OF_S + d) * wide] += f->a[d] * x;
    if (w->along.mass) continue;
    for (int d = 0; d < 6; d++) {
      to[(OF_U + d) * wide] += f->v[d] * x + 2.0 * f->a[d] * dx;
      to[(OF_Z + d) * wide] += f->q[d] * x + f->v[d] * dx + f->a[d] * ddx;
    }
    for (int d = 0; d < 3; d++) to[(OF_V + d) * wide] += f->b[d] * x;
  }
}

void add_own(const Tables *t, Path *w, Int block, double scale, const double *left, const Lane *row,
             Int stride) {
  Int n = columns_of(t, block), used = lanes_of(n);
  Lane *own = w->rows + w->rows_at[block] + n * ROWS * row_lanes(t, block);
  for (Int k = 0; k < n; k++, own += OWN * used) {
    double x = scale * left[k];
    if (x == 0.0) continue;
    for (int part = 0; part < (w->mass ? 1 : OWN); part++)
      for (Int c = 0; c < used; c++) own[part * used + c] += x * row[part * stride + c];
  }
}

static Lane sum_six(const double *f, const Lane *x, Int deep) {
  return f[0] * x[0] + f[1] * x[deep] + f[2] * x[2 * deep] + f[3] * x[3 * deep] + f[4] * x[4 * deep]
         + f[5] * x[5 * deep];
}

static Lane sum_three(const double *f, const Lane *x, Int deep) {
  return f[0] * x[0] + f[1] * x[deep] + f[2] * x[2 * deep];
}

/* The path's lanes of a row of M. */
static void meet_mass(const double *f, const Lane *S, Int deep, Int lanes, Lane *M) {
  for (Int c = 0; c < lanes; c++) M[c] += sum_six(f, S + c, deep);
}

/* The path's lanes of three rows, and of two columns, of M, C and K. */
static void meet_rows(const double *f, const Lane *S, Int deep, Int lanes, Int length, Lane *M) {
  const Lane *U = S + OF_U * deep, *Z = S + OF_Z * deep, *V = S + OF_V * deep, *turn = S + 3 * deep;
  Lane *C = M + length, *K = C + length;
  for (Int c = 0; c < lanes; c++) {
    M[c] += sum_six(f, S + c, deep);
    C[c] += sum_six(f, U + c, deep) + sum_three(f + OF_V, turn + c, deep);
    K[c] += sum_six(f, Z + c, deep) + sum_three(f + OF_V, V + c, deep);
  }
}

static void meet_columns(const double *f, const Lane *S, Int deep, Int lanes, Int length, Lane *C) {
  for (Int c = 0; c < lanes; c++) {
    C[c] += sum_six(f + OF_U, S + c, deep);
    C[length + c] += sum_six(f + OF_Z, S + c, deep);
  }
}

/* What a block needs of those before it, and how that before it moves it: all that a chain has to know. */
static void join(const Tables *t, Path *w, Int block, int inside) {
  Int n = columns_of(t, block), above = t->block_above[block];
  double *to = w->joined + t->joined_at[block];
  for (Int k = 0; k < n; k++)
    for (int d = 0; d < NUMBERS; d++)
      to[NUMBERS * k + d] += ((const double *)(w->need + d * w->wide))[k];
  if (inside || above < 0) return;
  Int before = columns_of(t, above);
  to += NUMBERS * n;
  for (int d = 0; d < NUMBERS; d++)
    memcpy(to + before * d, (const double *)(w->moved + d * w->deep) + t->block_depth[above],
           before * sizeof(double));
}

void meet(const Tables *t, Path *w, Int block, Int before) {
  Int length = row_lanes(t, block), inside = before >= 0 && t->node_block[before] == block;
  Int lanes = inside ? length : lanes_of(t->block_depth[block]);
  Int first = first_lane(t, w, block);
  Lane *row = w->rows + w->rows_at[block] + first;
  if (t->joined_at[t->blocks]) join(t, w, block, inside);
  if (lanes <= first) return;
  for (Int k = 0; k < columns_of(t, block); k++, row += ROWS * length) {
    double f[NUMBERS], most = 0.0;
    for (int d = 0; d < NUMBERS; d++) {
      f[d] = ((const double *)(w->need + d * w->wide))[k];
      most += fabs(f[d]);
    }
    if (most == 0.0) continue;
    if (w->mass) {
      meet_mass(f, w->moved, w->deep, lanes, row);
      continue;
    }
    meet_rows(f, w->moved + first, w->deep, lanes - first, length, row);
    meet_columns(f, w->moved + first, w->deep, lanes - first, length, row + 3 * length);
  }
}

/* M of one block against one on its path, or itself. */
static void put_mass(const Tables *t, const Path *w, Int block, Int above, double *M) {
  Int nv = t->nv, n = columns_of(t, block), wide = columns_of(t, above), length = LANES * row_lanes(t, block);
  const double *m = (const double *)(w->rows + w->rows_at[block]);
  for (Int k = 0; k < n; k++) {
    Int row = t->block_at[block] + k;
    for (Int j = 0; j < wide; j++) {
      Int column = t->block_at[above] + j;
      double x = m[ROWS * length * k + t->block_depth[above] + j];
      M[row * nv + column] += x, M[column * nv + row] += x;
    }
  }
  const double *own = m + ROWS * length * n;
  for (Int k = 0; k < n && above == block; k++, own += OWN * LANES * lanes_of(n))
    for (Int j = 0; j < n; j++) M[(t->block_at[block] + k) * nv + t->block_at[block] + j] += own[j];
}

/* Rows and columns of one block against those of one on its path. */
static void put(const Tables *t, const Path *w, Int block, Int above, double *M, double *C,
                double *K) {
  Int nv = t->nv, n = columns_of(t, above), to = t->block_at[above];
  Int rows = columns_of(t, block), first = t->block_at[block];
  Int stride = LANES * row_lanes(t, block);
  const double *m = (const double *)(w->rows + w->rows_at[block]) + t->block_depth[above];
  for (Int k = 0; k < rows; k++, m += ROWS * stride)
    for (Int j = 0, here = (first + k) * nv + to; j < n; j++, here++)
      M[here] += m[j], C[here] += m[stride + j], K[here] += m[2 * stride + j];
  m -= rows * ROWS * stride;
  for (Int j = 0; j < n; j++, m++) /* columns of one row together */
    for (Int k = 0, there = (to + j) * nv + first; k < rows; k++, there++) {
      const double *at = m + ROWS * stride * k;
      M[there] += at[0], C[there] += at[3 * stride], K[there] += at[4 * stride];
    }
}

/* What the joints of a block need by themselves. */
static void put_own(const Tables *t, const Path *w, Int block, double *M, double *C, double *K) {
  Int n = columns_of(t, block), stride = LANES * lanes_of(n);
  const double *own = (const double *)(w->rows + w->rows_at[block] + n * ROWS * row_lanes(t, block));
  for (Int k = 0; k < n; k++, own += OWN * stride) {
    Int to = (t->block_at[block] + k) * t->nv + t->block_at[block];
    for (Int j = 0; j < n; j++)
      M[to + j] += own[j], C[to + j] += own[stride + j], K[to + j] += own[2 * stride + j];
  }
}

void put_paths(const Tables *t, const Path *w, double *M, double *C, double *K) {
  for (Int b = w->from; b < w->to && w->mass; b++)
    for (Int above = b; above >= 0; above = t->block_above[above]) put_mass(t, w, b, above, M);
  for (Int b = w->from; b < w->to && !w->mass; b++) {
    put_own(t, w, b, M, C, K);
    for (Int above = b; above >= 0; above = w->within ? -1 : t->block_above[above])
      put(t, w, b, above, M, C, K);
  }
}

void clear(const Tables *t, const Path *w, double *M) {
  Int nv = t->nv;
  if (!w->within) memset(M, 0, nv * nv * sizeof(double));
  for (Int b = 0; b < t->blocks && w->within; b++)
    for (Int i = t->block_at[b]; i < t->block_at[b + 1]; i++)
      memset(M + i * nv + t->block_at[b], 0, columns_of(t, b) * sizeof(double));
}
