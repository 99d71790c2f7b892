/* What sleeves on beams do to the bodies and to the beams: rows h(z, eta), see sleeve_rows.c.

   z = (p, e_x, e_y) is frame b in frame a, R' (p_b - p_a), R' b_x, R' b_y. A multiplier lam pushes

     force lam R h_p at p_b,   moment lam sum e x R h_e     on B, the opposite on A,
     lam h_eta                                              on the coordinates of the beam. */
#include "moments.h"
#include "sleeves.h"

/* How far beyond the root of a stretch, over its length, a sleeve is on it: the curvature jumps
   there, and a sleeve at rest at a border would be on either side by turns. */
static const double PAST = 1e-6;
/* Jets that a sleeve's rows take at most, and looks at tracks: a fixed sleeve over two borders, with
   nine rows, takes less than 195 and 11. */
enum { JETS = 240, VALUES = 16 };

Int sleeve_room(const Tables *t) {
  Int most = 0, entries = 0;
  for (Int k = 0; k < t->sleeves; k++) {
    Int track = t->stretch_track[t->stretch_at[k]], n = t->entry_at[track + 1] - t->entry_at[track];
    Int m = FIRST + (t->sleeve_passes[k] ? 3 : 1) * t->track_n[track];
    most = most > m ? most : m;
    entries = entries > n ? entries : n;
  }
  Int bending = 3 * (t->nv - t->nv_rigid);
  return t->sleeves ? JETS * jet_size(most, 1) + 4 * VALUES * entries + bending + 18 * t->nv : 0;
}

static void pose_of(const Work *lanes, Int node, int l, const double *local, Pose *out) {
  const Node *n = node < 0 ? &lanes->base : lanes->node + node;
  for (int d = 0; d < 3; d++) {
    double R[3] = {n->R[3 * d][l], n->R[3 * d + 1][l], n->R[3 * d + 2][l]};
    for (int e = 0; e < 3; e++)
      out->R[3 * d + e] = R[0] * local[e] + R[1] * local[4 + e] + R[2] * local[8 + e];
    out->p[d] = n->p[d][l] + R[0] * local[3] + R[1] * local[7] + R[2] * local[11];
  }
}

void sleeve_of_lane(const Tables *t, const Work *lanes, Int sleeve, int l, Sleeve *w, Pose *a,
                    Pose *b) {
  Int first = t->stretch_at[sleeve], count = t->nv - t->nv_rigid;
  memset(w, 0, sizeof *w);
  w->t = t, w->sleeve = sleeve, w->on = first, w->room.at = lanes->room;
  pose_of(lanes, t->sleeve_node[sleeve], l, t->sleeve_frame + 12 * sleeve, b);
  /* As many stretches as have a root that it has passed lie behind it. */
  for (Int k = first + 1; k < t->stretch_at[sleeve + 1]; k++) {
    double x = 0.0;
    pose_of(lanes, t->stretch_node[k], l, t->stretch_frame + 12 * k, a);
    for (int d = 0; d < 3; d++) x += (b->p[d] - a->p[d]) * a->R[3 * d];
    w->on += x >= PAST * t->stretch_length[k];
  }
  pose_of(lanes, t->stretch_node[w->on], l, t->stretch_frame + 12 * w->on, a);
  for (int d = 0; d < 3; d++)
    for (int e = 0; e < 3; e++) {
      w->z[d] += a->R[3 * e + d] * (b->p[e] - a->p[e]);
      w->z[3 + d] += a->R[3 * e + d] * b->R[3 * e];
      w->z[6 + d] += a->R[3 * e + d] * b->R[3 * e + 1];
    }
  double *eta = take(&w->room, 3 * count);
  for (Int i = 0; i < count; i++) {
    eta[i] = lanes->eta[i][l];
    eta[count + i] = lanes->rate[i][l], eta[2 * count + i] = lanes->growth[i][l];
  }
  w->eta = eta, w->rate = eta + count, w->growth = eta + 2 * count;
  find_sleeve(w);
}

void normals(const Pose *a, const double *h, double *n) {
  for (int k = 0; k < 3; k++)
    for (int d = 0; d < 3; d++) {
      const double *by = h + 2 + 3 * k, *R = a->R + 3 * d;
      n[3 * k + d] = R[0] * by[0] + R[1] * by[1] + R[2] * by[2];
    }
}

/* The wrench of the world at b: n[0..3], and the moments e x n. */
static void wrench_at(const Pose *b, const double *n, double *wrench) {
  double turned[3];
  for (int d = 0; d < 3; d++) wrench[d] = n[d], wrench[3 + d] = 0.0;
  for (int axis = 0; axis < 2; axis++) {
    double e[3] = {b->R[axis], b->R[3 + axis], b->R[6 + axis]};
    crossed(e, n + 3 + 3 * axis, turned);
    for (int d = 0; d < 3; d++) wrench[3 + d] += turned[d];
  }
}

/* Add a wrench at b to a node, in one lane. */
static void push(Node *node, int l, const Pose *b, const double *n, double sign) {
  double arm[3], M[3];
  for (int d = 0; d < 3; d++) arm[d] = b->p[d] - node->p[d][l];
  crossed(arm, n, M);
  for (int d = 0; d < 3; d++) M[d] += n[3 + d];
  for (int d = 0; d < 3; d++)
    for (int e = 0; e < 3; e++) {
      node->F[d][l] += sign * node->R[3 * e + d][l] * n[e];
      node->N[d][l] += sign * node->R[3 * e + d][l] * M[e];
    }
}

/* Coordinates of the beam that a jet has: to += k h_eta. */
static void add_by_eta(const Sleeve *w, const double *h, double k, Lane *to, int l) {
  for (Int part = 0; part < 3; part++) {
    Int stretch = w->on - 1 + part, first = w->reached[part];
    if (!first) continue;
    Int n = w->t->track_n[w->t->stretch_track[stretch]], at = w->t->stretch_eta[stretch];
    for (Int i = 0; i < n; i++) to[at + i][l] += k * h[1 + first + i];
  }
}

void push_sleeves(const Tables *t, Work *lanes, const Lane *lam, Lane *c) {
  for (Int i = 0; i < t->nv - t->nv_rigid; i++) lanes->beam[i] = lane(0);
  for (Int k = 0; k < t->sleeves; k++)
    for (int l = 0; l < LANES; l++) {
      Sleeve w;
      Pose a, b;
      Jet h[MOST_SLEEVE_ROWS];
      double total[9] = {0}, n[9], wrench[6];
      sleeve_of_lane(t, lanes, k, l, &w, &a, &b);
      sleeve_rows(&w, COORDINATES, 0, h);
      for (Int at = t->sleeve_at[k]; at < t->sleeve_at[k + 1]; at++) {
        const double *row = h[at - t->sleeve_at[k]];
        double x = lam[t->sleeve_row[at]][l];
        c[t->sleeve_row[at]][l] = row[0];
        normals(&a, row, n);
        for (int d = 0; d < 9; d++) total[d] += x * n[d];
        add_by_eta(&w, row, x, lanes->beam, l);
      }
      wrench_at(&b, total, wrench);
      for (int d = 0; lanes->wrench && d < 6; d++)
        lanes->wrench[6 * t->sleeve_loop[k] + d][l] = wrench[d];
      push(node_at(lanes, t->sleeve_node[k]), l, &b, wrench, -1.0);
      push(node_at(lanes, t->stretch_node[w.on]), l, &b, wrench, 1.0);
    }
}

void sleeve_places(const Tables *t, const Work *lanes, Int count, double *out) {
  for (Int k = 0; k < t->sleeves; k++)
    for (int l = 0; l < count && l < LANES; l++) {
      Sleeve w;
      Pose a, b;
      sleeve_of_lane(t, lanes, k, l, &w, &a, &b);
      out[l * t->sleeves + k] = sleeve_place(&w);
    }
}
