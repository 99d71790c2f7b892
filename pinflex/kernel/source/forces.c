/* What joints, loops and sleeves carry: of a node (F, N) of the tree, in its own axes about its origin,
   by which the joint above holds it and all that hangs on it; g, the forces of the expanded
   coordinates; of a loop force and moment on its B about the origin of frame b, in the world. */
#include "group.h"

/* Residuals r (count, nv), closures c (count, closures) and g (count, nV) of `count` states; wrenches
   of some nodes (count, wanted, 6) and of the loops (count, loops, 6), and forces of sleeves on
   their beams (count, sleeves, 3, 8), see sleeve_forces.c. */
EXPORT void pinflex_forces(const Tables *t, char *memory, Int count, const double *Y, const double *V,
                           const double *A, const double *lam, const double *scale, Int wanted,
                           const Int *nodes, double *r, double *c, double *g, double *f,
                           double *loops, double *sleeves) {
  Work w;
  Group at;
  lay_out(t, memory, &w, &at);
  w.wrench = at.wrench;
  for (Int first = 0; first < count; first += LANES) {
    gather(Y, count, t->nq, first, at.y);
    gather(V, count, t->nv, first, at.v);
    gather(A, count, t->nv, first, at.a);
    gather(lam, count, t->closures, first, at.lam);
    gather(scale, count, t->forces, first, at.scale);
    residual_group(t, &w, at.y, at.v, at.a, at.lam, at.scale, at.r, at.c);
    scatter(at.r, count, t->nv, first, r);
    scatter(at.c, count, t->closures, first, c);
    scatter(w.V, count, t->nV, first, g);
    scatter(at.wrench, count, 6 * t->loops, first, loops);
    for (Int k = 0; k < wanted; k++)
      for (int l = 0; l < LANES && first + l < count; l++)
        for (int d = 0; d < 3; d++) {
          const Node *n = w.node + nodes[k];
          double *out = f + 6 * ((first + l) * wanted + k);
          out[d] = n->F[d][l], out[3 + d] = n->N[d][l];
        }
    sleeve_forces(t, &w, at.lam, count - first, sleeves + 24 * first * t->sleeves);
  }
}
