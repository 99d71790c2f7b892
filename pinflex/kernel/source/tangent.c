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

   The map adds X' D X, what the rates of its rows bring, and the forces on curved rows times G.
   Source: Singh, Russo, Wensing (2022), their B written with moments of momentum. */
#include "tangent.h"
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

/* T[i] += D_ij X_j and what the rates of row j bring; D holds dg/da, dg/dv, dg/dq. Rows of T have
   the columns of their own leg. */
void gain(const Tables *t, Tangent *w, Int i, Int j, const double *D) {
  Int at = t->x_at[j], n = t->x_at[j + 1] - at, own = t->own_at[i + 1] - t->own_at[i];
  double *M = w->T + 3 * t->own_at[i] + t->own_first[j], *C = M + own, *K = C + own;
  const double *x = w->x + at, *dx = w->dx + at, *ddx = w->ddx + at;
  for (Int k = 0; k < n; k++) {
    M[k] += D[0] * x[k];
    C[k] += D[1] * x[k] + 2.0 * D[0] * dx[k];
    K[k] += D[2] * x[k] + D[1] * dx[k] + D[0] * ddx[k];
  }
}

/* Columns of one joint against themselves and those of all joints before it. */
static void couple(const Tables *t, Tangent *w, Int first, Int n, Int before, const Moments *I,
                   const double *f) {
  for (Int i = first; i < first + n; i++) {
    const Column *own = w->column + i;
    double by_a[6], by_v[6], by_q[6], back[3], follow[6];
    inertia_times(I, own->S, by_a);
    inertia_times(I, own->U, by_v);
    inertia_times(I, own->Z, by_q);
    add_momentum_times(I, own->S, by_v);
    add_momentum_times(I, own->Y, by_q);
    wrench_cross(own->S, f, follow);
    for (int d = 0; d < 6; d++) by_q[d] += follow[d];
    momentum_transposed(I, own->S, back);
    for (Int j = first; j < first + n; j++) {
      const Column *c = w->column + j;
      double D[3] = {times(by_a, c->S, 6), times(by_a, c->U, 6) + times(back, c->S + 3, 3),
                     times(by_a, c->Z, 6) + times(back, c->Y + 3, 3)};
      gain(t, w, i, j, D);
    }
    for (Int node = before; node >= 0; node = t->parent[node])
      for (Int j = t->node_v[node]; j < t->node_v[node] + width(t->kind[node]); j++) {
        const Column *c = w->column + j;
        double D[3] = {times(by_a, c->S, 6), times(by_a, c->U, 6) + times(back, c->S + 3, 3),
                       times(by_a, c->Z, 6) + times(back, c->Y + 3, 3)};
        double E[3] = {D[0], times(c->S, by_v, 6), times(c->S, by_q, 6)};
        gain(t, w, i, j, D);
        gain(t, w, j, i, E);
      }
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

static void leaf(const Tables *t, Tangent *w, Int node, Int first, Int n, Moments *I) {
  double v[6], a[6], f[6];
  move_columns(frozen_at(w, node), w->rate + first, w->growth + first, n, w->column + first, v, a);
  set_momentum(I, v);
  wrench_of(I, v, a, f);
  couple(t, w, first, n, node, I, f);
  if (node >= 0) add_moments(&w->frozen[node].I, I);
}

static void leaves(const Tables *t, Tangent *w) {
  for (Int k = 0; k < t->points; k++) {
    const Frozen *up = frozen_at(w, t->point_node[k]);
    const double *R = t->point_R + 9 * k;
    double s[3], c[3], n[3];
    Moments I;
    for (int d = 0; d < 3; d++) s[d] = t->point_p[3 * k + d] + times(R + 3 * d, w->u + 3 * k, 3);
    rotated(up->R, s, c);
    for (int d = 0; d < 3; d++) c[d] += up->p[d];
    for (int d = 0; d < 3; d++) {
      double axis[3] = {R[d], R[3 + d], R[6 + d]};
      rotated(up->R, axis, n);
      slide_column(n, w->column[t->point_v[k] + d].S);
    }
    point_moments(t->point_mass[k], c, &I);
    leaf(t, w, t->point_node[k], t->point_v[k], 3, &I);
  }
  for (Int k = 0; k < t->twists; k++) {
    const Frozen *up = frozen_at(w, t->twist_node[k]);
    double n[3], inertia = t->twist_inertia[k];
    Moments I = {0};
    rotated(up->R, t->twist_axis + 3 * k, n);
    turn_column(n, up->p, w->column[t->twist_v[k]].S);
    for (int d = 0; d < 3; d++)
      for (int e = 0; e < 3; e++)
        I.J[3 * d + e] = inertia * ((d == e ? 0.5 : 0.0) - n[d] * n[e]);
    leaf(t, w, t->twist_node[k], t->twist_v[k], 1, &I);
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
  for (Int k = 0; k < t->nv_rigid; k++) w->x[t->x_at[t->v_at[k]]] = 1.0;
  for (Int e = 0; e < t->rows; e++) {
    Int row = t->row_v[e], from = t->x_at[row] - (t->col_first[row] - t->nv_rigid);
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

/* M, C, K = X' T, with G times the forces on curved rows, stiffness, damping and springs. */
static void gather_up(const Tables *t, const Work *lanes, const Tangent *w, double *M, double *C,
                      double *K) {
  Int nv = t->nv, size = nv * nv * (Int)sizeof(double), m = t->nv_rigid;
  memset(M, 0, size), memset(C, 0, size), memset(K, 0, size);
  for (Int i = 0; i < t->nV; i++) {
    Int own = t->own_at[i + 1] - t->own_at[i], leg = t->leg_of[i];
    for (Int k = t->x_at[i]; k < t->x_at[i + 1]; k++) {
      const double *T = w->T + 3 * t->own_at[i];
      double x = w->x[k];
      Int to = (t->col_first[i] + k - t->x_at[i]) * nv;
      for (Int part = t->range_at[leg]; part < t->range_at[leg + 1]; part++) {
        Int from = to + t->range_from[part], n = t->range_last[part] - t->range_from[part] + 1;
        for (Int j = 0; j < n; j++) {
          M[from + j] += x * T[j];
          C[from + j] += x * T[own + j];
          K[from + j] += x * T[2 * own + j];
        }
        T += n;
      }
    }
  }
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
         + even(3 * t->own_at[t->nV]) + 4 * even(6 * t->nv);
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
  w->T = memory, memory += even(3 * t->own_at[t->nV]);
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

/* The first lane of the states counts. Afterwards r and c hold its residuals. */
void tangent(const Tables *t, Work *lanes, double *memory, Int rates, const Lane *y,
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
  memset(w.T, 0, 3 * t->own_at[t->nV] * sizeof(double));
  leaves(t, &w);
  for (Int i = t->nodes - 1; i >= 0; i--) {
    const Frozen *here = w.frozen + i;
    couple(t, &w, t->node_v[i], width(t->kind[i]), t->parent[i], &here->I, here->f);
    if (t->parent[i] >= 0) add_moments(&w.frozen[t->parent[i]].I, &here->I);
  }
  added_tangent(t, &w);
  for (Int i = 0; i < t->nV; i++) {
    double rotor[3] = {t->armature[i], 0.0, 0.0};
    if (rotor[0] != 0.0) gain(t, &w, i, i, rotor);
  }
  gather_up(t, lanes, &w, M, C, K);
  curvature_tangent(t, y + t->nq_rigid, w.lifted, K + t->nv_rigid * (t->nv + 1));
  close_tangent(t, &w, lam, K, J);
  sleeve_tangent(t, lanes, &w, lam, K, J);
  load_tangent(t, &w, scale, C, K);
  friction_tangent(t, v, C);
}
