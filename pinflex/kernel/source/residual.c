/* The residual of many states: r = X' (rnea - J_Q' lam) + K y + D v and c, a group at a time. */
#include "group.h"
#include "tangent.h"

static Int padded(Int bytes) { return (bytes + 63) / 64 * 64; }

/* Bytes of the workspace of one run: nodes, then Q, V, A, the group's inputs and outputs, and what
   the tangent needs. */
EXPORT Int pinflex_work_size(const Tables *t) {
  Int lanes = t->nQ + 2 * t->nV + t->nq + 4 * t->nv + 3 * t->closures + t->forces
              + 4 * (t->squares + t->products) + 6 * t->loops;
  return padded(t->nodes * (Int)sizeof(Node)) + padded(lanes * (Int)sizeof(Lane))
         + (tangent_size(t) + sleeve_room(t) + 2 * t->kinks) * (Int)sizeof(double);
}

void lay_out(const Tables *t, char *memory, Work *w, Group *g) {
  w->node = (Node *)memory;
  w->Q = (Lane *)(memory + padded(t->nodes * (Int)sizeof(Node)));
  w->V = w->Q + t->nQ;
  w->A = w->V + t->nV;
  w->moving = t->dampers + t->added + t->sleeves + t->touches > 0;
  g->y = w->A + t->nV;
  g->v = g->y + t->nq;
  g->a = g->v + t->nv;
  g->r = g->a + t->nv;
  g->lam = g->r + t->nv;
  g->c = g->lam + t->closures;
  g->open = g->c + t->closures;
  g->scale = g->open + t->closures;
  w->beam = g->scale + t->forces;
  w->product = w->beam + t->nv - t->nv_rigid;
  w->push = w->product + 3 * t->products;
  w->square = w->push + t->products;
  g->wrench = w->square + 4 * t->squares;
  w->wrench = 0;
  g->more = (double *)(((uintptr_t)(g->wrench + 6 * t->loops) + 63) / 64 * 64);
  w->room = g->more + tangent_size(t);
  w->hit = w->room + sleeve_room(t);
  w->piece = (Int *)(w->hit + t->kinks);
}

void balance(const Tables *t, Work *w, int placed, const Lane *lam, const Lane *scale, Lane *c) {
  outward(t, w, placed);
  add_masses(t, w, scale);
  close_loops(t, w, lam, c);
  apply_loads(t, w, scale);
  inward(t, w);
  for (Int k = 0; k < t->nV; k++) w->V[k] += t->armature[k] * w->A[k];
  couple_joints(t, w, lam, c);
}

void residual_group(const Tables *t, Work *w, const Lane *y, const Lane *v, const Lane *a,
                    const Lane *lam, const Lane *scale, Lane *r, Lane *c) {
  expand(t, w, y, v, a);
  balance(t, w, t->loops + t->forces + t->springs + t->added + t->touches > 0, lam, scale, c);
  project(t, w, y, v, r);
}

void gather(const double *from, Int count, Int width, Int first, Lane *to) {
  if (first + 1 == count) {
    for (Int i = 0; i < width; i++) to[i] = lane(from[first * width + i]);
    return;
  }
  for (int l = 0; l < LANES; l++) {
    const double *row = from + (first + l < count ? first + l : count - 1) * width;
    for (Int i = 0; i < width; i++) to[i][l] = row[i];
  }
}

void scatter(const Lane *from, Int count, Int width, Int first, double *to) {
  for (int l = 0; l < LANES && first + l < count; l++)
    for (Int i = 0; i < width; i++) to[(first + l) * width + i] = from[i][l];
}

/* Residuals of `count` states, arrays row by row: Y (count, nq), V, A, R (count, nv), lam and C
   (count, closures), scales of the loads (count, forces). */
EXPORT void pinflex_residuals(const Tables *t, char *memory, Int count, const double *Y,
                              const double *V, const double *A, const double *lam,
                              const double *scale, double *R, double *C) {
  Work w;
  Group g;
  lay_out(t, memory, &w, &g);
  for (Int first = 0; first < count; first += LANES) {
    gather(Y, count, t->nq, first, g.y);
    gather(V, count, t->nv, first, g.v);
    gather(A, count, t->nv, first, g.a);
    gather(lam, count, t->closures, first, g.lam);
    gather(scale, count, t->forces, first, g.scale);
    residual_group(t, &w, g.y, g.v, g.a, g.lam, g.scale, g.r, g.c);
    scatter(g.r, count, t->nv, first, R);
    scatter(g.c, count, t->closures, first, C);
  }
}

/* Power that damping, friction and dampers between frames take in `count` states, W. */
EXPORT void pinflex_losses(const Tables *t, char *memory, Int count, const double *Y,
                           const double *V, double *power) {
  Work w;
  Group g;
  for (Int k = 0; k < count; k++) power[k] = dissipation(t, V + k * t->nv);
  if (!t->dampers && !t->kinks) return;
  lay_out(t, memory, &w, &g);
  for (Int k = 0; t->kinks && k < count; k++)
    power[k] += kink_loss(t, &w, Y + k * t->nq, V + k * t->nv);
  if (!t->dampers && !t->touches) return;
  for (Int i = 0; i < t->nv; i++) g.a[i] = lane(0);
  for (Int first = 0; first < count; first += LANES) {
    gather(Y, count, t->nq, first, g.y);
    gather(V, count, t->nv, first, g.v);
    expand(t, &w, g.y, g.v, g.a);
    outward(t, &w, 1);
    Lane taken = damper_power(t, &w);
    for (int l = 0; l < LANES && first + l < count; l++) power[first + l] += taken[l];
  }
}

/* Closures of `count` states in motion, (count, closures), and their first and second time
   derivatives. */
EXPORT void pinflex_closure_motion(const Tables *t, char *memory, Int count, const double *Y,
                                   const double *V, const double *A, double *value,
                                   double *rate, double *second) {
  Work w;
  Group g;
  lay_out(t, memory, &w, &g);
  w.moving = 1;
  for (Int first = 0; first < count; first += LANES) {
    gather(Y, count, t->nq, first, g.y);
    gather(V, count, t->nv, first, g.v);
    gather(A, count, t->nv, first, g.a);
    expand(t, &w, g.y, g.v, g.a);
    coupling_motion(t, &w, g.open, g.lam, g.c);
    outward(t, &w, 1);
    closure_motion(t, &w, g.open, g.lam, g.c);
    scatter(g.open, count, t->closures, first, value);
    scatter(g.lam, count, t->closures, first, rate);
    scatter(g.c, count, t->closures, first, second);
  }
}

/* Closures and their Jacobians at `count` poses Y (count, nq): c (count, closures) and J (count,
   closures, nv). */
EXPORT void pinflex_closures(const Tables *t, char *memory, Int count, const double *Y, double *c,
                             double *J) {
  Work w;
  Group g;
  Tangent here;
  lay_out(t, memory, &w, &g);
  w.moving = 1;
  for (Int i = 0; i < t->nv; i++) g.v[i] = g.a[i] = lane(0);
  for (Int k = 0; k < count; k++) {
    gather(Y, k + 1, t->nq, k, g.y);
    expand(t, &w, g.y, g.v, g.a);
    coupling_motion(t, &w, g.open, g.lam, g.c);
    outward(t, &w, 1);
    closure_motion(t, &w, g.open, g.lam, g.c);
    scatter(g.open, k + 1, t->closures, k, c);
    place_columns(t, &w, g.more, g.y, g.v, g.a, &here);
    close_jacobian(t, &here, J + k * t->closures * t->nv);
    sleeve_tangent(t, &w, &here, 0, 0, J + k * t->closures * t->nv);
  }
}

void stand(const Tables *t, Work *w, Group *g, const double *Y, Int count, Int first) {
  for (Int i = 0; i < t->nv; i++) g->v[i] = g->a[i] = lane(0);
  gather(Y, count, t->nq, first, g->y);
  expand(t, w, g->y, g->v, g->a);
  outward(t, w, 1);
}

static void derivatives(const Tables *t, char *memory, Work *w, Group *g, Int part, Int rates,
                        const double *y, const double *v, const double *a, const double *lam,
                        const double *scale, double *M, double *C, double *K, double *J) {
  lay_out(t, memory, w, g);
  gather(y, 1, t->nq, 0, g->y);
  gather(v, 1, t->nv, 0, g->v);
  gather(a, 1, t->nv, 0, g->a);
  gather(lam, 1, t->closures, 0, g->lam);
  gather(scale, 1, t->forces, 0, g->scale);
  tangent(t, w, g->more, part, rates, g->y, g->v, g->a, g->lam, g->scale, g->r, g->c, M, C, K, J);
}

/* Derivatives of the residual at one state: M, C, K (nv, nv) by a, v, y and J (closures, nv).
   Without `rates` those of the map's rows are left out. */
EXPORT void pinflex_tangent(const Tables *t, char *memory, Int rates, const double *y, const double *v,
                            const double *a, const double *lam, const double *scale, double *M,
                            double *C, double *K, double *J) {
  tangent_part(t, memory, WHOLE, rates, y, v, a, lam, scale, M, C, K, J);
}

void tangent_part(const Tables *t, char *memory, Int part, Int rates, const double *y, const double *v,
                  const double *a, const double *lam, const double *scale, double *M, double *C,
                  double *K, double *J) {
  Work w;
  Group g;
  derivatives(t, memory, &w, &g, part, rates, y, v, a, lam, scale, M, C, K, J);
}

void motion(const Tables *t, char *memory, Int wanted, const double *y, const double *v,
            const double *a, const double *lam, const double *scale, double *matrices, double *r,
            double *rates) {
  Work w;
  Group g;
  Int square = t->nv * t->nv;
  double *M = matrices, *C = M + square, *K = C + square;
  derivatives(t, memory, &w, &g, WHOLE, wanted, y, v, a, lam, scale, M, C, K, K + square);
  scatter(g.r, 1, t->nv, 0, r);
  closure_rates(t, g.more, rates);
  sleeve_motion(t, &w, g.open, g.lam, g.c);
  for (Int k = t->sleeve_at[0]; k < t->sleeve_at[t->sleeves]; k++)
    rates[t->sleeve_row[k]] = g.c[t->sleeve_row[k]][0];
}

/* Derivatives M, C, K, J one after the other, residual and second derivatives of the closures of
   one motion. */
EXPORT void pinflex_motion(const Tables *t, char *memory, const double *y, const double *v,
                           const double *a, const double *lam, const double *scale,
                           double *matrices, double *r, double *rates) {
  motion(t, memory, WITH_RATES, y, v, a, lam, scale, matrices, r, rates);
}

/* Where the sleeves are on their links at `count` poses Y (count, nq), m: (count, sleeves). */
EXPORT void pinflex_sleeves(const Tables *t, char *memory, Int count, const double *Y, double *out) {
  Work w;
  Group g;
  lay_out(t, memory, &w, &g);
  for (Int first = 0; first < count; first += LANES) {
    stand(t, &w, &g, Y, count, first);
    sleeve_places(t, &w, count - first, out + first * t->sleeves);
  }
}
