/* Energies of motions, J:

     kinetic   m c'.c' / 2 + w.(I w) / 2 of nodes, c' = v + w x c;   m s'.s' / 2 of mass points;
               I (w.n + c')^2 / 2 of twists;   V armature V / 2;   v' M v / 2 of added masses
     gravity   - m g . x of centres and points in the world
     elastic   eta' K eta / 2, and what large bends add (strain.c)
     spring    k (q - rest)^2 / 2 of joints, and springs and loads at frames (loads.c)

   and those of laws of pieces (kinks.c), elastic where they are of elastic coordinates. */
#include "group.h"

/* Of a mass that stands at r in a node and moves in it by u. */
static void add_mass(const Tables *t, const Node *n, double m, const Lane *r, const Lane *u,
                     Lane *kinetic, Lane *gravity) {
  Lane v[3], x[3];
  cross(n->w, r, v);
  turn(n->R, r, x);
  for (int d = 0; d < 3; d++) {
    v[d] += n->v[d] + u[d];
    *gravity -= m * t->gravity[d] * (n->p[d] + x[d]);
  }
  *kinetic += 0.5 * m * dot(v, v);
}

static void nodes(const Tables *t, Work *w, Lane *kinetic, Lane *gravity) {
  const Lane still[3] = {0};
  for (Int i = 0; i < t->nodes; i++) {
    const Node *n = w->node + i;
    const double *com = t->com + 3 * i;
    Lane spin[3], c[3] = {lane(com[0]), lane(com[1]), lane(com[2])};
    add_mass(t, n, t->mass[i], c, still, kinetic, gravity);
    turn_by(t->inertia + 9 * i, n->w, spin);
    *kinetic += 0.5 * dot(n->w, spin);
  }
}

static void points(const Tables *t, Work *w, Lane *kinetic, Lane *gravity) {
  for (Int k = 0; k < t->points; k++) {
    Lane s[3], v[3];
    turn_by(t->point_R + 9 * k, w->Q + t->point_q[k], s);
    turn_by(t->point_R + 9 * k, w->V + t->point_v[k], v);
    for (int d = 0; d < 3; d++) s[d] += t->point_p[3 * k + d];
    add_mass(t, node_at(w, t->point_node[k]), t->point_mass[k], s, v, kinetic, gravity);
  }
}

static Lane of_twists(const Tables *t, Work *w) {
  Lane kinetic = lane(0);
  for (Int k = 0; k < t->twists; k++) {
    const double *axis = t->twist_axis + 3 * k;
    const Lane *about = node_at(w, t->twist_node[k])->w;
    Lane spin = axis[0] * about[0] + axis[1] * about[1] + axis[2] * about[2] + w->V[t->twist_v[k]];
    kinetic += 0.5 * t->twist_inertia[k] * spin * spin;
  }
  return kinetic;
}

static Lane of_added(const Tables *t, Work *w, const Lane *scale) {
  Lane kinetic = lane(0);
  for (Int k = 0; k < t->added; k++) {
    const Node *n = node_at(w, t->added_node[k]);
    Lane own = lane(0);
    for (int d = 0; d < 6; d++)
      for (int e = 0; e < 6; e++)
        own += 0.5 * t->added_inertia[36 * k + 6 * d + e] * (d < 3 ? n->v[d] : n->w[d - 3])
               * (e < 3 ? n->v[e] : n->w[e - 3]);
    kinetic += added_share(t, k, scale) * own;
  }
  return kinetic;
}

static Lane sprung(const Tables *t, Work *w, const Lane *y, const Lane *scale) {
  Lane energy = load_energy(t, w, scale) + kink_energy(t, w, y, 0);
  for (Int k = 0; k < t->joint_springs; k++) {
    const double *law = t->joint_spring_law + 2 * k;
    Lane off = joint_spring_angle(t, k, y) - law[1];
    energy += 0.5 * law[0] * off * off;
  }
  return energy;
}

/* Energies of `count` states, kinetic, gravity, elastic and spring: (4, count). */
EXPORT void pinflex_energies(const Tables *t, char *memory, Int count, const double *Y,
                             const double *V, const double *scale, double *out) {
  Work w;
  Group g;
  lay_out(t, memory, &w, &g);
  w.moving = 1;
  for (Int i = 0; i < t->nv; i++) g.a[i] = lane(0);
  for (Int first = 0; first < count; first += LANES) {
    Lane kinetic, gravity = lane(0), each[4];
    gather(Y, count, t->nq, first, g.y);
    gather(V, count, t->nv, first, g.v);
    gather(scale, count, t->forces, first, g.scale);
    expand(t, &w, g.y, g.v, g.a);
    outward(t, &w, 1);
    expand(t, &w, g.y, g.v, g.a); /* the way outward leaves forces in V */
    kinetic = of_twists(t, &w) + of_added(t, &w, g.scale);
    for (Int i = 0; i < t->nV; i++) kinetic += 0.5 * t->armature[i] * w.V[i] * w.V[i];
    nodes(t, &w, &kinetic, &gravity);
    points(t, &w, &kinetic, &gravity);
    each[0] = kinetic, each[1] = gravity;
    each[2] = strain_energy(t, w.eta) + kink_energy(t, &w, g.y, 1), each[3] = sprung(t, &w, g.y, g.scale);
    for (int k = 0; k < 4; k++) scatter(each + k, count, 1, first, out + k * count);
  }
}
