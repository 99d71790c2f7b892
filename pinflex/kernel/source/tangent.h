/* What the tangent of one state needs, in plain numbers and in the world. */
#ifndef PINFLEX_TANGENT_H
#define PINFLEX_TANGENT_H

#include "kernel.h"
#include "moments.h"

/* A node: pose, motion, acceleration, wrench of its subtree; I of the subtree when it is its turn. */
typedef struct { double R[9], p[3], v[6], a[6], f[6]; Moments I; } Frozen;

/* A velocity of the expanded model. */
typedef struct { double S[6], Y[6], Z[6], U[6]; } Column;

/* Coordinates side by side: on the path to a node, `end`, and in one block (path.c); room for nine rows
   of a block, and all rows and columns of M, C and K. */
typedef struct {
  Int end, deep, wide, *rows_at, within, mass; /* rows of each block, or M, alone */
  Int from, to;                                /* blocks of this part */
  Lane *moved, *need, *map, *rows;
  double *joined; /* of each block: needs (columns, 21), and `moved` of the block before, (21, columns) */
} Path;

/* What a column i needs: I S_i, B S_i + I U_i, B Y_i + I Z_i + S_i x f, and B' S_i. */
typedef struct { double a[6], v[6], q[6], b[3]; } Needs;

/* u: places of the mass points in their joints. lifted: room for four (6, nv). */
typedef struct {
  Frozen base, *frozen;
  Column *column;
  double *x, *dx, *ddx, *rate, *growth, *u, *lifted, *M, *C, *K;
  Path along;
} Tangent;

/* Poses and columns of the nodes where `outward` has been, for `close_jacobian`. */
void place_columns(const Tables *t, Work *lanes, double *memory, const Lane *y, const Lane *v,
                   const Lane *a, Tangent *w);
Int tangent_size(const Tables *t);
void tangent_layout(const Tables *t, double *memory, Tangent *w);
void tangent(const Tables *t, Work *lanes, double *memory, Int part, Int rates, const Lane *y,
             const Lane *v, const Lane *a, const Lane *lam, const Lane *scale, Lane *r, Lane *c, double *M,
             double *C, double *K, double *J);

/* Velocities that a node has: width of its joint. */
static inline Int width(Int kind) { return (Int[]){1, 1, 1, 3, 3, 6, 3}[kind]; }

/* lifted.c: columns of a node's support times the map, (6, nv); and K += sign J' S D, J' P */
void lift(const Tables *t, const Tangent *w, Int node, double *out);
void lift_speeds(const Tables *t, const Tangent *w, Int node, double *out); /* sum Y_j x_j + S_j x_j' */
void add_product(Int nv, const double *J, const double *S, const double *D, double sign,
                 double *pushed, double *K);
void add_transposed(Int nv, const double *J, const double *P, double sign, double *K);

/* load_tangent.c */
void load_tangent(const Tables *t, Work *lanes, Tangent *w, const Lane *scale, double *C, double *K);
void touch_tangents(const Tables *t, Work *lanes, Tangent *w, double *C, double *K); /* touch.c */

/* closure_tangent.c */
void close_jacobian(const Tables *t, Tangent *w, double *J);
void close_tangent(const Tables *t, Tangent *w, const Lane *lam, double *K, double *J);

/* path.c: S, U, Z and V of a node. What columns of a block need is summed up and met with the path to
   the node before them (what they need by themselves, scale left' row, is added apart: three rows,
   `stride` lanes from each other), and in the end put into M, C and K. */
Int path_room(const Tables *t);
void path_layout(const Tables *t, double *memory, Path *w);
void begin_paths(const Tables *t, Path *w, Int part, Int wanted);
static inline int in_part(const Path *w, Int block) { return block >= w->from && block < w->to; }
void go_to(const Tables *t, Tangent *w, Int node);
void begin_needs(Path *w);
void add_needs(const Tables *t, Tangent *w, Int i, const Needs *f);
void meet(const Tables *t, Path *w, Int block, Int before);
void add_own(const Tables *t, Path *w, Int block, double scale, const double *left, const Lane *row,
             Int stride);
void put_paths(const Tables *t, const Path *w, double *M, double *C, double *K);
void clear(const Tables *t, const Path *w, double *M); /* what these put */

/* point_tangent.c: what mass points need, which their nodes carry */
void point_tangent(const Tables *t, const Work *lanes, Tangent *w);

/* added_mass.c, strain.c */
void added_tangent(const Tables *t, Tangent *w, const Lane *scale);
void curvature_tangent(const Tables *t, const Lane *eta, double *u, double *K);

/* couplings.c */
void coupling_jacobian(const Tables *t, const Tangent *w, double *J);
void coupling_rates(const Tables *t, const Tangent *w, double *out);

/* sleeve_tangent.c: rows of J, and K where that is wanted, from the first lane */
void sleeve_tangent(const Tables *t, const Work *lanes, Tangent *w, const Lane *lam, double *K,
                    double *J);

/* A frame of a node, [R | p] (3, 4) in its axes, in the world. */
typedef struct { double R[9], p[3]; } Frame;

static inline void frame_of(const Frozen *n, const double *local, Frame *out) {
  for (int d = 0; d < 3; d++) {
    const double *row = n->R + 3 * d;
    for (int e = 0; e < 3; e++)
      out->R[3 * d + e] = row[0] * local[e] + row[1] * local[4 + e] + row[2] * local[8 + e];
    out->p[d] = n->p[d] + row[0] * local[3] + row[1] * local[7] + row[2] * local[11];
  }
}

/* closure_rates.c: second derivatives of the closures where a tangent was taken */
void closure_rates(const Tables *t, double *memory, double *out);

#endif
