/* Derivatives of the residual at one state: M = dr/da, C = dr/dv, K = dr/dy, and J = dc/dy.

   Six-vectors in the world: motions (v at the world's origin, w), wrenches (F, N about it). With S
   the columns of a joint, v and a the motion of the node before it, and of a joint's subtree m, h,
   J the mass, its first and second moments, P and Z = sum m v p' the momentum and its moments:

     Y = v x S,   Z = a x S + v x Y,   U = Y + (v of the node) x S
     I (a, b) = (m a + b x h, h x a + tr(J) b - J b),   B (a, b) = 2 (b x P, tr(Z) b - Z b)

     dg_i/dq_j = S_i . (B Y_j + I Z_j)         j a joint before i, or a column of the same joint
     dg_i/dv_j = S_i . (B S_j + I U_j)         likewise
     dg_j/dq_i = S_j . (B Y_i + I Z_i + S_i x f_i),   f_i the wrench of the subtree
     dg_j/dv_i = S_j . (B S_i + I U_i)
     dg_i/da_j = S_i . I S_j

   All columns j before i are taken at once, and by the coordinates that they depend on: path.c. The
   forces on curved rows times G are added.
   Source: Singh, Russo, Wensing (2022), their B written with moments of momentum. */
#include "tangent.h"
#include "group.h"
#include <string.h>

/* The column of a joint that slides along, or turns about, a direction at a place. */
static void slide_column(const double *n, double *S) {
  memcpy(S, n, 3 * sizeof(double));
  S[3] = S[4] = S[5] = 0.0;
}

static void turn_column(const double *n, const double *p, double *S) {
  crossed(p, n, S);
  memcpy(S + 3, n, 3 * sizeof(double));
}

/* Columns S of a node's joint. */
static void node_columns(const Tables *t, Int i, const Frozen *here, Column *out) {
  double n[3], axes[9];
  for (int d = 0; d < 9; d++) axes[3 * (d % 3) + d / 3] = here->R[d]; /* one after the other */
  rotated(here->R, t->axis + 3 * i, n);
  switch (t->kind[i]) {
    case REVOLUTE:
    case CIRCLE: turn_column(n, here->p, out[0].S); break;
    case SLIDE: slide_column(n, out[0].S); break;
    case TRANSLATION:
      for (int d = 0; d < 3; d++) slide_column(axes + 3 * d, out[d].S);
      break;
    case BALL:
      for (int d = 0; d < 3; d++) turn_column(axes + 3 * d, here->p, out[d].S);
      break;
    case FREE:
      for (int d = 0; d < 3; d++) {
        slide_column(axes + 3 * d, out[d].S);
        turn_column(axes + 3 * d, here->p, out[3 + d].S);
      }
      break;
    default:
      slide_column(axes, out[0].S);
      slide_column(axes + 3, out[1].S);
      turn_column(axes + 6, here->p, out[2].S);
  }
}

/* Motion and acceleration after a joint, and Y, Z, U of its columns. */
static void move_columns(const Frozen *up, const double *rate, const double *growth, Int n,
                         Column *c, double *v, double *a) {
  double relative[6] = {0}, swept[6];
  memcpy(a, up->a, sizeof up->a);
  for (Int k = 0; k < n; k++)
    for (int d = 0; d < 6; d++) relative[d] += c[k].S[d] * rate[k], a[d] += c[k].S[d] * growth[k];
  motion_cross(up->v, relative, swept);
  for (int d = 0; d < 6; d++) v[d] = up->v[d] + relative[d], a[d] += swept[d];
  for (Int k = 0; k < n; k++) {
    double twice[6];
    motion_cross(up->v, c[k].S, c[k].Y);
    motion_cross(up->a, c[k].S, c[k].Z);
    motion_cross(up->v, c[k].Y, twice);
    motion_cross(v, c[k].S, c[k].U);
    for (int d = 0; d < 6; d++) c[k].Z[d] += twice[d], c[k].U[d] += c[k].Y[d];
  }
}

/* D_ij = (dg_i/da_j, dg_i/dv_j, dg_i/dq_j) of n columns j of one joint, times x_j: what column i needs by
   the coordinates of the joint itself, into three rows. */
static void own_rows(const Tables *t, const Tangent *w, Int first, Int n, const double (*D)[3],
                     Lane *row) {
  Int used = lanes_of(columns_of(t, t->block_of[first])), wide = w->along.wide;
  for (Int c = 0; c < used; c++) {
    Lane a = lane(0), v = lane(0), q = lane(0);
    for (Int j = 0; j < n; j++) {
      Int at = t->x_at[first + j] + LANES * c;
      Lane x = *(Lane *)(w->x + at), dx = *(Lane *)(w->dx + at), ddx = *(Lane *)(w->ddx + at);
      a += D[j][0] * x;
      v += D[j][1] * x + 2.0 * D[j][0] * dx;
      q += D[j][2] * x + D[j][1] * dx + D[j][0] * ddx;
    }
    row[c] = a, row[wide + c] = v, row[2 * wide + c] = q;
  }
}

/* Columns of one joint against themselves, and what they need of the path before. */
static void couple(const Tables *t, Tangent *w, Int first, Int n, const Moments *I, const double *f) {
  for (Int i = first; i < first + n; i++) {
    const Column *own = w->column + i;
    Needs need;
    double follow[6], D[6][3];
    inertia_times(I, own->S, need.a);
    inertia_times(I, own->U, need.v);
    inertia_times(I, own->Z, need.q);
    add_momentum_times(I, own->S, need.v);
    add_momentum_times(I, own->Y, need.q);
    wrench_cross(own->S, f, follow);
    for (int d = 0; d < 6; d++) need.q[d] += follow[d];
    momentum_transposed(I, own->S, need.b);
    add_needs(t, w, i, &need);
    for (Int j = 0; j < n; j++) {
      const Column *c = w->column + first + j;
      D[j][0] = times(need.a, c->S, 6) + (first + j == i ? t->armature[i] : 0.0);
      D[j][1] = times(need.a, c->U, 6) + times(need.b, c->S + 3, 3);
      D[j][2] = times(need.a, c->Z, 6) + times(need.b, c->Y + 3, 3);
    }
    own_rows(t, w, first, n, D, w->along.map);
    add_own(t, &w->along, t->block_of[i], 1.0, w->x + t->x_at[i], w->along.map, w->along.wide);
  }
}

/* I a + v x I v: the wrench of a leaf. */
static void wrench_of(const Moments *I, const double *v, const double *a, double *f) {
  double momentum[6], swept[6];
  inertia_times(I, v, momentum);
  inertia_times(I, a, f);
  wrench_cross(v, momentum, swept);
  for (int d = 0; d < 6; d++) f[d] += swept[d];
}

static const Frozen *frozen_at(const Tangent *w, Int number) {
  return number < 0 ? &w->base : w->frozen + number;
}

/* Twists are leaves, each with the moments of a turning body. */
static void twist_tangent(const Tables *t, Tangent *w) {
  for (Int k = 0; k < t->twists; k++) {
    Int node = t->twist_node[k], first = t->twist_v[k];
    const Frozen *up = frozen_at(w, node);
    Column *c = w->column + first;
    double n[3], v[6], a[6], f[6], inertia = t->twist_inertia[k];
    Moments I = {0};
    rotated(up->R, t->twist_axis + 3 * k, n);
    turn_column(n, up->p, c->S);
    for (int d = 0; d < 3; d++)
      for (int e = 0; e < 3; e++)
        I.J[3 * d + e] = inertia * ((d == e ? 0.5 : 0.0) - n[d] * n[e]);
    move_columns(up, w->rate + first, w->growth + first, 1, c, v, a);
    set_momentum(&I, v);
    wrench_of(&I, v, a, f);
    if (node >= 0) add_moments(&w->frozen[node].I, &I);
    if (!in_part(&w->along, t->block_of[first])) continue;
    begin_needs(&w->along);
    couple(t, w, first, 1, &I, f);
    go_to(t, w, node);
    meet(t, &w->along, t->block_of[first], node);
  }
}

/* Nodes with all that hangs on them; what they need is met on the path to the node before. */
static void node_tangent(const Tables *t, Tangent *w) {
  for (Int i = t->nodes - 1; i >= 0; i--)
    if (t->parent[i] >= 0) add_moments(&w->frozen[t->parent[i]].I, &w->frozen[i].I);
  for (Int i = 0; i < t->nodes; i++) {
    const Frozen *here = w->frozen + i;
    if (!in_part(&w->along, t->node_block[i])) continue;
    begin_needs(&w->along);
    couple(t, w, t->node_v[i], width(t->kind[i]), &here->I, here->f);
    go_to(t, w, t->parent[i]);
    meet(t, &w->along, t->node_block[i], t->parent[i]);
  }
}

/* Pose, motion and the body's own moments of every node, outward. */
static void freeze(const Tables *t, const Work *lanes, Tangent *w) {
  memset(&w->base, 0, sizeof w->base);
  for (int d = 0; d < 3; d++) w->base.R[4 * d] = 1.0, w->base.a[d] = -t->gravity[d];
  for (Int i = 0; i < t->nodes; i++) {
    const Node *n = lanes->node + i;
    Frozen *here = w->frozen + i;
    Int first = t->node_v[i];
    double c[3], arm[3], F[3], N[3];
    for (int d = 0; d < 9; d++) here->R[d] = n->R[d][0];
    for (int d = 0; d < 3; d++) here->p[d] = n->p[d][0], F[d] = n->F[d][0], N[d] = n->N[d][0];
    node_columns(t, i, here, w->column + first);
    move_columns(frozen_at(w, t->parent[i]), w->rate + first, w->growth + first, width(t->kind[i]),
                 w->column + first, here->v, here->a);
    rotated(here->R, t->com + 3 * i, c);
    for (int d = 0; d < 3; d++) c[d] += here->p[d];
    point_moments(t->mass[i], c, &here->I);
    add_tensor(here->R, t->inertia + 9 * i, &here->I);
    set_momentum(&here->I, here->v);
    rotated(here->R, F, here->f);
    rotated(here->R, N, here->f + 3);
    crossed(here->p, here->f, arm);
    for (int d = 0; d < 3; d++) here->f[3 + d] += arm[d];
  }
}

/* Rows of X = Phi + G eta and their rates: dX = G v, ddX = G a. */
static void map_rows(const Tables *t, Tangent *w, Int rates, const Lane *y, const Lane *v,
                     const Lane *a) {
  const Lane *eta = y + t->nq_rigid, *rate = v + t->nv_rigid, *growth = a + t->nv_rigid;
  Int entries = t->x_at[t->nV];
  memset(w->x, 0, entries * sizeof(double));
  memset(w->dx, 0, entries * sizeof(double));
  memset(w->ddx, 0, entries * sizeof(double));
  for (Int k = 0; k < t->nv_rigid; k++) {
    Int row = t->v_at[k];
    w->x[t->x_at[row] + k - t->block_at[t->block_of[row]]] = 1.0;
  }
  for (Int e = 0; e < t->rows; e++) {
    Int row = t->row_v[e], from = t->x_at[row] - (t->block_at[t->block_of[row]] - t->nv_rigid);
    double *x = w->x + from, *dx = w->dx + from, *ddx = w->ddx + from;
    for (Int p = t->phi_at[e]; p < t->phi_at[e + 1]; p++) x[t->phi_i[p]] += t->phi[p];
    for (Int p = t->g_at[e]; p < t->g_at[e + 1]; p++) {
      Int i = t->g_i[p], j = t->g_j[p];
      double g = t->g[p];
      x[i] += g * eta[j][0], x[j] += g * eta[i][0];
      if (!rates) continue;
      dx[i] += g * rate[j][0], dx[j] += g * rate[i][0];
      ddx[i] += g * growth[j][0], ddx[j] += g * growth[i][0];
    }
  }
}

/* G times the forces on curved rows, stiffness, damping and springs. */
static void add_stiffness(const Tables *t, const Work *lanes, Tangent *w) {
  Int nv = t->nv, m = t->nv_rigid;
  double *C = w->C, *K = w->K;
  for (Int e = 0; e < t->rows; e++)
    for (Int p = t->g_at[e]; p < t->g_at[e + 1]; p++) {
      double push = t->g[p] * lanes->V[t->row_v[e]][0];
      Int i = m + t->g_i[p], j = m + t->g_j[p];
      K[i * nv + j] += push, K[j * nv + i] += push;
    }
  for (Int i = 0; i < nv - m; i++)
    for (Int p = t->k_at[i]; p < t->k_at[i + 1]; p++) K[(m + i) * nv + m + t->k_j[p]] += t->k[p];
  for (Int i = 0; i < nv; i++)
    for (Int p = t->d_at[i]; p < t->d_at[i + 1]; p++) C[i * nv + t->d_j[p]] += t->d[p];
  for (Int k = 0; k < t->joint_springs; k++)
    K[t->joint_spring_v[k] * (nv + 1)] += t->joint_spring_law[2 * k];
}

static Int even(Int n) { return (n + 7) / 8 * 8; }

/* Doubles that the tangent's workspace takes. */
Int tangent_size(const Tables *t) {
  Int frozen = even(t->nodes * (Int)(sizeof(Frozen) / sizeof(double)));
  Int column = even(t->nV * (Int)(sizeof(Column) / sizeof(double)));
  return frozen + column + 3 * even(t->x_at[t->nV]) + 2 * even(t->nV) + even(3 * t->points)
         + even(path_room(t)) + 4 * even(6 * t->nv);
}

void tangent_layout(const Tables *t, double *memory, Tangent *w) {
  Int entries = even(t->x_at[t->nV]);
  w->frozen = (Frozen *)memory;
  memory += even(t->nodes * (Int)(sizeof(Frozen) / sizeof(double)));
  w->column = (Column *)memory;
  memory += even(t->nV * (Int)(sizeof(Column) / sizeof(double)));
  w->x = memory, memory += entries;
  w->dx = memory, memory += entries;
  w->ddx = memory, memory += entries;
  w->rate = memory, memory += even(t->nV);
  w->growth = memory, memory += even(t->nV);
  w->u = memory, memory += even(3 * t->points);
  path_layout(t, memory, &w->along), memory += even(path_room(t));
  w->lifted = memory;
}

void place_columns(const Tables *t, Work *lanes, double *memory, const Lane *y, const Lane *v,
                   const Lane *a, Tangent *w) {
  tangent_layout(t, memory, w);
  map_rows(t, w, 0, y, v, a);
  memset(&w->base, 0, sizeof w->base);
  for (int d = 0; d < 3; d++) w->base.R[4 * d] = 1.0;
  for (Int i = 0; i < t->nodes; i++) {
    const Node *n = lanes->node + i;
    Frozen *here = w->frozen + i;
    for (int d = 0; d < 9; d++) here->R[d] = n->R[d][0];
    for (int d = 0; d < 3; d++) here->p[d] = n->p[d][0];
    node_columns(t, i, here, w->column + t->node_v[i]);
  }
}

EXPORT void pinflex_joined(const Tables *t, char *memory, double *to) {
  Work lanes;
  Group g;
  Tangent w;
  lay_out(t, memory, &lanes, &g);
  tangent_layout(t, g.more, &w);
  memcpy(to, w.along.joined, t->joined_at[t->blocks] * sizeof(double));
}

/* The first lane of the states counts. Afterwards r and c hold its residuals. The FORMER part begins
   M, C and K, the LATTER adds to them, at the same state, and has J. */
void tangent(const Tables *t, Work *lanes, double *memory, Int part, Int rates, const Lane *y,
             const Lane *v, const Lane *a, const Lane *lam, const Lane *scale, Lane *r, Lane *c, double *M,
             double *C, double *K, double *J) {
  Tangent w;
  tangent_layout(t, memory, &w);
  map_rows(t, &w, rates, y, v, a);
  expand(t, lanes, y, v, a);
  for (Int i = 0; i < t->nV; i++) w.rate[i] = lanes->V[i][0], w.growth[i] = lanes->A[i][0];
  for (Int k = 0; k < t->points; k++)
    for (int d = 0; d < 3; d++) w.u[3 * k + d] = lanes->Q[t->point_q[k] + d][0];
  balance(t, lanes, 1, lam, scale, c);
  project(t, lanes, y, v, r);
  freeze(t, lanes, &w);
  w.M = M, w.C = C, w.K = K;
  begin_paths(t, &w.along, part, rates);
  if (part != LATTER) clear(t, &w.along, M);
  if (part != LATTER && rates != MASS) clear(t, &w.along, C), clear(t, &w.along, K);
  point_tangent(t, lanes, &w);
  twist_tangent(t, &w);
  node_tangent(t, &w);
  put_paths(t, &w.along, M, C, K);
  if (part == FORMER) return;
  if (rates == MASS) {
    close_jacobian(t, &w, J);
    sleeve_tangent(t, lanes, &w, lam, 0, J);
    return;
  }
  added_tangent(t, &w, scale);
  add_stiffness(t, lanes, &w);
  curvature_tangent(t, y + t->nq_rigid, w.lifted, K + t->nv_rigid * (t->nv + 1));
  close_tangent(t, &w, lam, K, J);
  sleeve_tangent(t, lanes, &w, lam, K, J);
  load_tangent(t, lanes, &w, scale, C, K);
  friction_tangent(t, v, C);
  kink_tangent(t, lanes, y, v, C, K);
}
