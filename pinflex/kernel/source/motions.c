/* Where nodes are and how they move: [R | p] in the world, (3, 4), and in the node's own axes the
   velocity v of its origin, its rate of turn w, and their spatial acceleration

     b = a + g - w x v,   alpha        a: acceleration of the origin less gravity, as in the tree

   Node -1 is the base. */
#include "group.h"

static void write_pose(const Node *n, int l, double *out) {
  for (int d = 0; d < 3; d++) {
    for (int e = 0; e < 3; e++) out[4 * d + e] = n->R[3 * d + e][l];
    out[4 * d + 3] = n->p[d][l];
  }
}

static void spatial(const Tables *t, const Node *n, Lane *rates) {
  Lane g[3], swept[3];
  const Lane down[3] = {lane(t->gravity[0]), lane(t->gravity[1]), lane(t->gravity[2])};
  turn_back(n->R, down, g);
  cross(n->w, n->v, swept);
  for (int d = 0; d < 3; d++) {
    rates[d] = n->v[d], rates[3 + d] = n->w[d];
    rates[6 + d] = n->a[d] + g[d] - swept[d], rates[9 + d] = n->alpha[d];
  }
}

/* Poses of some nodes at `count` poses Y (count, nq): (wanted, count, 12). */
EXPORT void pinflex_poses(const Tables *t, char *memory, Int count, const double *Y, Int wanted,
                          const Int *nodes, double *poses) {
  Work w;
  Group g;
  lay_out(t, memory, &w, &g);
  for (Int first = 0; first < count; first += LANES) {
    stand(t, &w, &g, Y, count, first);
    for (Int k = 0; k < wanted; k++)
      for (int l = 0; l < LANES && first + l < count; l++)
        write_pose(node_at(&w, nodes[k]), l, poses + 12 * (k * count + first + l));
  }
}

/* Poses of some nodes at `count` states, and v, w, b, alpha: (wanted, count, 12) both. */
EXPORT void pinflex_motions(const Tables *t, char *memory, Int count, const double *Y,
                            const double *V, const double *A, Int wanted, const Int *nodes,
                            double *poses, double *rates) {
  Work w;
  Group g;
  lay_out(t, memory, &w, &g);
  w.moving = 1;
  for (Int first = 0; first < count; first += LANES) {
    gather(Y, count, t->nq, first, g.y);
    gather(V, count, t->nv, first, g.v);
    gather(A, count, t->nv, first, g.a);
    expand(t, &w, g.y, g.v, g.a);
    outward(t, &w, 1);
    for (Int k = 0; k < wanted; k++) {
      const Node *n = node_at(&w, nodes[k]);
      Lane own[12];
      spatial(t, n, own);
      scatter(own, count, 12, first, rates + 12 * k * count);
      for (int l = 0; l < LANES && first + l < count; l++)
        write_pose(n, l, poses + 12 * (k * count + first + l));
    }
  }
}
