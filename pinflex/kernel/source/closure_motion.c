/* Closures of several states and their time derivatives, from the motion of the nodes.

   With d the gap, u an axis of a, e one of b, of a frame that turns by w, alpha: u' = w x u and
   u'' = alpha x u + w x u'; gravity, which is in both accelerations, leaves their difference.

     point      c = u . d     c' = u' . d + u . d'   c'' = u'' . d + 2 u' . d' + u . d''
     direction  c = u . e     c' = u' . e + u . e'   c'' = u'' . e + 2 u' . e' + u . e''
     distance   c = (d . d - l^2) / (2 l)   c' = d . d' / l   c'' = (d' . d' + d . d'') / l */
#include "sleeves.h"

typedef struct { Lane x[3], dx[3], ddx[3]; } Moving;

/* A vector r fixed in a node, in the world: itself and its rates. */
static void turning(const Node *n, const double *r, Moving *u) {
  Lane own[3] = {lane(r[0]), lane(r[1]), lane(r[2])}, first[3], second[3], swept[3];
  cross(n->w, own, first);
  cross(n->w, first, second);
  cross(n->alpha, own, swept);
  for (int d = 0; d < 3; d++) second[d] += swept[d];
  turn(n->R, own, u->x);
  turn(n->R, first, u->dx);
  turn(n->R, second, u->ddx);
}

/* The origin of a frame [R | p] (3, 4) of a node. */
static void moving(const Node *n, const double *local, Moving *x) {
  const double p[3] = {local[3], local[7], local[11]};
  Lane v[3], a[3];
  turning(n, p, x);
  turn(n->R, n->v, v);
  turn(n->R, n->a, a);
  for (int d = 0; d < 3; d++) x->x[d] += n->p[d], x->dx[d] += v[d], x->ddx[d] += a[d];
}

static void axis_of(const Node *n, const double *local, Int axis, Moving *u) {
  const double r[3] = {local[axis], local[4 + axis], local[8 + axis]};
  turning(n, r, u);
}

/* u . e and its rates. */
static void product_motion(const Moving *u, const Moving *e, Lane *value, Lane *rate, Lane *second) {
  *value = dot(u->x, e->x);
  *rate = dot(u->dx, e->x) + dot(u->x, e->dx);
  *second = dot(u->ddx, e->x) + 2.0 * dot(u->dx, e->dx) + dot(u->x, e->ddx);
}

/* Frame b of a node in frame a of another, as in sleeves.c: z and its rates. */
static void frame_motion(const Node *A, const double *a, const Node *B, const double *b, Lane z[3][9]) {
  Moving from, u, of[3];
  moving(A, a, &from);
  moving(B, b, of);
  for (int d = 0; d < 3; d++)
    of[0].x[d] -= from.x[d], of[0].dx[d] -= from.dx[d], of[0].ddx[d] -= from.ddx[d];
  axis_of(B, b, 0, of + 1);
  axis_of(B, b, 1, of + 2);
  for (int axis = 0; axis < 3; axis++) {
    axis_of(A, a, axis, &u);
    for (int k = 0; k < 3; k++) {
      int i = 3 * k + axis;
      product_motion(&u, of + k, z[0] + i, z[1] + i, z[2] + i);
    }
  }
}

/* Rows of sleeves as functions of time. */
void sleeve_motion(const Tables *t, Work *w, Lane *value, Lane *rate, Lane *second) {
  for (Int k = 0; k < t->sleeves; k++)
    for (int l = 0; l < LANES; l++) {
      Sleeve s;
      Pose a, b;
      Jet h[MOST_SLEEVE_ROWS];
      Lane z[3][9];
      sleeve_of_lane(t, w, k, l, &s, &a, &b);
      frame_motion(node_at(w, t->stretch_node[s.on]), t->stretch_frame + 12 * s.on,
                   node_at(w, t->sleeve_node[k]), t->sleeve_frame + 12 * k, z);
      for (int i = 0; i < 9; i++) s.dz[i] = z[1][i][l], s.ddz[i] = z[2][i][l];
      sleeve_rows(&s, TIME, 1, h);
      for (Int at = t->sleeve_at[k]; at < t->sleeve_at[k + 1]; at++) {
        const double *row = h[at - t->sleeve_at[k]];
        value[t->sleeve_row[at]][l] = row[0];
        rate[t->sleeve_row[at]][l] = row[2];
        second[t->sleeve_row[at]][l] = row[hess(&s.room, 1, 1)];
      }
    }
}

void closure_motion(const Tables *t, Work *w, Lane *value, Lane *rate, Lane *second) {
  for (Int k = 0; k < t->loops; k++) {
    const Node *A = node_at(w, t->node_a[k]), *B = node_at(w, t->node_b[k]);
    const double *a = t->frame_a + 12 * k, *b = t->frame_b + 12 * k;
    Moving gap, from, u, e;
    moving(A, a, &from);
    moving(B, b, &gap);
    for (int d = 0; d < 3; d++)
      gap.x[d] -= from.x[d], gap.dx[d] -= from.dx[d], gap.ddx[d] -= from.ddx[d];
    for (Int at = t->loop_at[k]; at < t->loop_at[k + 1]; at++) {
      Int row = t->row_number[at];
      if (t->row_kind[at] == DISTANCE) {
        double l = t->row_length[at];
        value[row] = (dot(gap.x, gap.x) - l * l) / (2.0 * l);
        rate[row] = dot(gap.x, gap.dx) / l;
        second[row] = (dot(gap.dx, gap.dx) + dot(gap.x, gap.ddx)) / l;
        continue;
      }
      axis_of(A, a, t->row_a[at], &u);
      if (t->row_kind[at] == POINT) e = gap;
      else axis_of(B, b, t->row_b[at], &e);
      product_motion(&u, &e, value + row, rate + row, second + row);
    }
  }
  sleeve_motion(t, w, value, rate, second);
}
