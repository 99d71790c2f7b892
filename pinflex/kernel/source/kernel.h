/* Tables of one system, the workspace of one run, and what the files of the kernel do for it.

   Equations and notation: pinflex/mechanics/evaluation/equations.py and expansion.py. The system is

     r(y, v, a, lam) = X' (rnea(Q, X v, X a + Xdot v) - J_Q' lam) + K y + D v + F(v),  c(y) = 0

   Rigid joints and interfaces are the nodes of a tree. Stations that are mere mass points, and
   twists, are no nodes: they are summed into the wrench of the node that carries them. */
#ifndef PINFLEX_KERNEL_H
#define PINFLEX_KERNEL_H

#include "lanes.h"


#ifndef EXPORT /* sources within another library hide them */
#define EXPORT __attribute__((visibility("default")))
#endif

/* Kinds of nodes. A circle is a revolute joint whose coordinates are cosine and sine; velocities of
   free and planar joints are those of the body in its own axes, as Pinocchio has them. */
enum { REVOLUTE, CIRCLE, SLIDE, TRANSLATION, BALL, FREE, PLANAR };
/* Kinds of closure rows. */
enum { POINT, DIRECTION, DISTANCE };

/* Counts, then arrays: each with its shape in brackets, which Python reads there. "name+1": starts of
   rows, whose last entry counts what "*name" has; n_eta = nv - nv_rigid. */
typedef struct {
  Int nq, nv, nq_rigid, nv_rigid, nQ, nV; /* y, v, their rigid parts, the expanded Q and V */
  Int nodes, points, twists, rows;        /* of the tree; elastic rows of the map */
  Int loops, closures;                    /* closures: their rows */
  Int forces, springs, dampers;           /* between frames */
  Int joint_springs, rubs, blocks;        /* blocks: of columns that joints depend on */
  Int couplings, added, bent;             /* joints that follow; added masses; large bends */
  Int sleeves, tracks;                    /* on beams; motions of sections along a beam */
  Int pairs, products;                    /* of coordinates that G multiplies; those in g_rest */
  Int squares;                            /* psi . eta, squared: rows of G as sums of them */
  Int kinks;                              /* laws of pieces, see kinks.c */
  Int touches;                            /* contacts, see touch.c */
  const Int *q_at;                                       /* [nq_rigid] of rigid q in Q */
  const Int *v_at;                                       /* [nv_rigid] of rigid v in V */
  const Int *parent, *kind, *node_q, *node_v;            /* [nodes] */
  const Int *about;                                      /* [nodes] axis, 0 to 2, see tree.c; or -1 */
  const Int *point_node, *point_q, *point_v;             /* [points] */
  const Int *twist_node, *twist_q, *twist_v;             /* [twists] */
  const Int *row_q, *row_v;                              /* [rows] elastic rows */
  const Int *phi_at;                                     /* [rows+1] */
  const Int *phi_i;                                      /* [*phi_at] Phi by rows */
  const Int *g_at;                                       /* [rows+1] */
  const Int *g_i, *g_j;                                  /* [*g_at] G, upper triangle by rows */
  const Int *g_pair;                                     /* [*g_at] numbers of pairs, each once: */
  const Int *g_first, *g_second;                         /* [pairs] products come first */
  const Int *x_at;                                       /* [nV+1] rows of X in lanes */
  const Int *block_of;                                   /* [nV] their blocks of columns */
  const Int *block_at;                                   /* [blocks+1] */
  const Int *block_above, *block_depth;                  /* [blocks] next on the path to the base; columns there */
  const Int *node_block;                                 /* [nodes] the last one on the path of a node */
  const Int *block_order;                                /* [blocks] from the base on */
  const Int *joined_at, *chain_at;                       /* [blocks+1] numbers of each for chain.c; 0: not used */
  const Int *node_a, *node_b;                            /* [loops] loops */
  const Int *loop_at;                                    /* [loops+1] their rows follow each other */
  const Int *row_kind, *row_number, *row_a, *row_b;      /* [*loop_at] closure rows */
  const Int *couple_row;                                 /* [couplings] couplings of joints */
  const Int *couple_at;                                  /* [couplings+1] */
  const Int *couple_q, *couple_v;                        /* [*couple_at] */
  const Int *added_node, *added_force;                   /* [added] the load in whose share it counts, or -1 */
  const Int *bent_first, *bent_n, *bent_directions;      /* [bent] strain.c */
  const Int *bent_at, *bent_point;                       /* [bent+1] */
  const Int *force_node, *force_follows, *force_works;   /* [forces] loads; works: without a potential */
  const Int *spring_a, *spring_b;                        /* [springs] springs between frames */
  const Int *joint_spring_v, *joint_spring_q, *joint_spring_paired; /* [joint_springs] */
  const Int *rub_v;                                      /* [rubs] joints with dry friction */
  const Int *k_at;                                       /* [n_eta+1] */
  const Int *k_j;                                        /* [*k_at] K of eta by rows */
  const Int *d_at;                                       /* [nv+1] */
  const Int *d_j;                                        /* [*d_at] D by rows */
  const Int *sleeve_node, *sleeve_loop, *sleeve_passes;  /* [sleeves] of b; whether stretches follow it */
  const Int *sleeve_at;                                  /* [sleeves+1] rows, see sleeve_rows.c */
  const Int *sleeve_row, *sleeve_sort, *sleeve_axis;     /* [*sleeve_at] */
  const Int *stretch_at;                                 /* [sleeves+1] */
  const Int *stretch_node, *stretch_eta, *stretch_track; /* [*stretch_at] pieces of their beams */
  const Int *track_n, *track_degrees;                    /* [tracks] coordinates; degree + 1 */
  const Int *entry_at;                                   /* [tracks+1] */
  const Int *entry_row, *entry_i, *entry_j;              /* [*entry_at] of Phi (j = -1) and G, see track.c */
  const Int *piece_at, *power_at;                        /* [tracks+1] */
  const Int *g_rest, *sum_from;                          /* [rows] products up to g_rest, then a sum */
  const Int *sum_at;                                     /* [rows+1] */
  const Int *square_at;                                  /* [squares+1] */
  const Int *square_eta;                                 /* [squares] first coordinate of each psi */
  const Int *kink_v, *kink_q, *kink_paired;              /* [kinks] a coordinate; v = -1: of a spring */
  const Int *kink_at;                                    /* [kinks+1] pieces */
  const Int *spring_kink;                                /* [springs] its law, or -1 */
  const Int *touch_a, *touch_b, *touch_shape, *touch_kink; /* [touches] */
  const double *gravity;                                 /* [3] */
  const double *R0;                                      /* [nodes, 9] */
  const double *p0, *axis;                               /* [nodes, 3] */
  const double *mass;                                    /* [nodes] */
  const double *com;                                     /* [nodes, 3] */
  const double *inertia;                                 /* [nodes, 9] */
  const double *point_R;                                 /* [points, 9] */
  const double *point_p;                                 /* [points, 3] */
  const double *point_mass;                              /* [points] */
  const double *twist_axis;                              /* [twists, 3] */
  const double *twist_inertia;                           /* [twists] */
  const double *phi;                                     /* [*phi_at] */
  const double *g;                                       /* [*g_at] */
  const double *frame_a, *frame_b;                       /* [loops, 12] [R | p], (3, 4) */
  const double *row_length;                              /* [*loop_at] */
  const double *couple_factor;                           /* [*couple_at] */
  const double *couple_offset;                           /* [couplings] */
  const double *added_inertia;                           /* [added, 36] */
  const double *bent_slope, *bent_bend;                  /* [*bent_at] */
  const double *bent_weight;                             /* [*bent_point] */
  const double *force_place;                             /* [forces, 3] */
  const double *force_load;                              /* [forces, 6] R F, R M or F, M */
  const double *spring_place_a, *spring_place_b, *spring_law; /* [springs, 3] law: stiffness, damper, length */
  const double *joint_spring_law;                        /* [joint_springs, 2] stiffness, rest */
  const double *rub_law;                                 /* [rubs, 4] F_c, E, v_s, v_0 */
  const double *k;                                       /* [*k_at] */
  const double *rest;                                    /* [n_eta] eta of links free of stress */
  const double *d;                                       /* [*d_at] */
  const double *armature;                                /* [nV] */
  const double *sleeve_frame;                            /* [sleeves, 12] [R | p] of b, (3, 4) */
  const double *sleeve_half;                             /* [sleeves] a, m */
  const double *stretch_frame;                           /* [*stretch_at, 12] root, (3, 4) */
  const double *stretch_length, *stretch_from;           /* [*stretch_at] m; from: on the link, m */
  const double *piece_start, *piece_half;                /* [*piece_at] m */
  const double *power;                                   /* [*power_at] (pieces, degree + 1, entries) */
  const double *sum;                                     /* [*sum_at] */
  const double *square;                                  /* [*square_at] psi */
  const double *touch_place_a, *touch_place_b, *touch_axis; /* [touches, 3] */
  const double *touch_law;                               /* [touches, 6] gap, mu, v_0, radius, E, v_s */
  const double *kink_start;                              /* [*kink_at] where pieces begin, rad | m */
  const double *kink_piece;                              /* [*kink_at, 7] see kinks.c */
} Tables;

/* A frame of the tree at one instant. In its own axes: w, alpha rates of turn, a the acceleration
   of its origin less gravity, v its velocity (where wanted), F and N the wrench about its
   origin that its subtree needs. E, r: pose in the parent. R, p: pose in the world. */
typedef struct {
  Lane E[9], r[3], w[3], alpha[3], a[3], v[3], R[9], p[3], F[3], N[3];
} Node;

/* Arrays of one group of states. V becomes the expanded forces once the way back is done. */
typedef struct {
  Node base, *node;
  Lane *Q, *V, *A;
  int moving; /* whether velocities of nodes are wanted */
  const Lane *eta, *rate, *growth; /* what `expand` was given */
  Lane *beam;   /* what sleeves do to eta */
  Lane *product; /* eta_i eta_j and its two rates of each pair, (products, 3) */
  Lane *push;    /* forces on them, (products,) */
  Lane *square; /* s = psi . eta, s^2 and its two rates, (squares, 4) */
  Lane *wrench; /* of loops on their B about frame b, (loops, 6), where wanted */
  double *room; /* of sleeves */
  Int *piece;   /* of each law: 1 + the piece that a step keeps to, or 0: that of the state */
  double *hit;  /* speed at which each was last entered, rad/s | m/s */
} Work;

/* map.c: Q = T(y), V = X v, A = X a + Xdot v; and X' g with K, D, springs and friction of joints */
void expand(const Tables *t, Work *w, const Lane *y, const Lane *v, const Lane *a);
void project(const Tables *t, const Work *w, const Lane *y, const Lane *v, Lane *r);
Lane joint_spring_angle(const Tables *t, Int k, const Lane *y); /* of spring k, rad | m */

/* tree.c */
void outward(const Tables *t, Work *w, int placed);
void inward(const Tables *t, Work *w);

/* friction.c */
void add_friction(const Tables *t, const Lane *v, Lane *r);
void friction_tangent(const Tables *t, const Lane *v, double *C);
double dissipation(const Tables *t, const double *v); /* power of damping and friction of joints, W */

/* kinks.c: a law of pieces at x and its rate: what it resists by, the derivatives of that, energy, J,
   and what it takes, W; all of them that are of coordinates; elongations, (count, kinks) */
typedef struct { double force, slope, damping, energy, loss; } Kink;
Kink kinked(const Tables *t, const Work *w, Int k, double x, double rate);
void add_kinks(const Tables *t, const Work *w, const Lane *y, const Lane *v, Lane *r);
void kink_tangent(const Tables *t, const Work *w, const Lane *y, const Lane *v, double *C, double *K);
Lane kink_energy(const Tables *t, const Work *w, const Lane *y, int elastic);
double kink_loss(const Tables *t, const Work *w, const double *y, const double *v);
EXPORT void pinflex_elongations(const Tables *t, char *memory, Int count, const double *Y, double *x);
int hardens(const Tables *t, const Int *piece);
int idle(const Tables *t, const Work *w, Int k);
void keep_to_pieces(const Tables *t, char *memory, const Int *piece, const double *hit);

/* closures.c, loads.c */
void close_loops(const Tables *t, Work *w, const Lane *lam, Lane *c);
void apply_loads(const Tables *t, Work *w, const Lane *scale);
void spring_lengths(const Tables *t, Work *w, Int k, Lane *length); /* of spring k, m */
Lane damper_power(const Tables *t, Work *w); /* of dampers between frames, W */
Lane load_energy(const Tables *t, Work *w, const Lane *scale); /* of springs and dead forces, J */

/* touch.c: forces; energy, J, or power taken, W; how far beyond their rims, into the laws, of a lane */
void apply_touches(const Tables *t, Work *w);
Lane touch_power(const Tables *t, Work *w, int stored);
void touch_places(const Tables *t, Work *w, Int lanes, double *x);

/* added_mass.c: of nodes whose motion is known */
void add_masses(const Tables *t, Work *w, const Lane *scale);
static inline Lane added_share(const Tables *t, Int k, const Lane *scale) {
  return t->added_force[k] < 0 ? lane(1.0) : scale[t->added_force[k]];
}

/* strain.c: what links resist, and their energy, J */
void add_strain(const Tables *t, const Lane *eta, Lane *r);
Lane strain_energy(const Tables *t, const Lane *eta);

/* couplings.c: the same rows and derivatives of joints that follow others */
void couple_joints(const Tables *t, Work *w, const Lane *lam, Lane *c);
void coupling_motion(const Tables *t, const Work *w, Lane *value, Lane *rate, Lane *second);

/* sleeves.c: c of their rows, and what they do to nodes and beams; where they are on their links (m),
   (count, sleeves) */
void push_sleeves(const Tables *t, Work *w, const Lane *lam, Lane *c);
void sleeve_places(const Tables *t, const Work *w, Int count, double *out);
void sleeve_forces(const Tables *t, const Work *w, const Lane *lam, Int count, double *out);
Int sleeve_room(const Tables *t);

/* closure_motion.c: closures of a group in motion, their first and second time derivatives */
void closure_motion(const Tables *t, Work *w, Lane *value, Lane *rate, Lane *second);
void sleeve_motion(const Tables *t, Work *w, Lane *value, Lane *rate, Lane *second);

/* residual.c: the tree outward and inward with all forces; poses of nodes where `placed` */
void balance(const Tables *t, Work *w, int placed, const Lane *lam, const Lane *scale, Lane *c);
void residual_group(const Tables *t, Work *w, const Lane *y, const Lane *v, const Lane *a,
                    const Lane *lam, const Lane *scale, Lane *r, Lane *c);

/* What of a tangent is wanted: without the rates of second-order rows, with them, and so within the blocks
   of a chain alone, where M, C and K outside are not written, or M and J alone (not of added masses). */
enum { WITHOUT_RATES, WITH_RATES, WITHIN_BLOCKS, MASS };
enum { WHOLE, FORMER, LATTER }; /* or halves, where a step shall not bear all of it (tangent.c) */

/* residual.c: of states row by row, and derivatives at one of them. motion: M, C, K and J one after the
   other, residual and second derivatives of the closures at one. */
EXPORT void pinflex_residuals(const Tables *t, char *memory, Int count, const double *Y,
                              const double *V, const double *A, const double *lam,
                              const double *scale, double *R, double *C);
EXPORT void pinflex_losses(const Tables *t, char *memory, Int count, const double *Y,
                           const double *V, double *power);
EXPORT void pinflex_tangent(const Tables *t, char *memory, Int rates, const double *y, const double *v,
                            const double *a, const double *lam, const double *scale, double *M,
                            double *C, double *K, double *J);
void tangent_part(const Tables *t, char *memory, Int part, Int rates, const double *y, const double *v,
                  const double *a, const double *lam, const double *scale, double *M, double *C,
                  double *K, double *J);
EXPORT void pinflex_motion(const Tables *t, char *memory, const double *y, const double *v,
                           const double *a, const double *lam, const double *scale,
                           double *matrices, double *r, double *rates);

/* The same of the matrices that are wanted, in their places. */
void motion(const Tables *t, char *memory, Int wanted, const double *y, const double *v,
            const double *a, const double *lam, const double *scale, double *matrices, double *r,
            double *rates);

/* Columns of a block, and the lanes that numbers take. */
static inline Int columns_of(const Tables *t, Int block) {
  return t->block_at[block + 1] - t->block_at[block];
}

static inline Int lanes_of(Int n) { return (n + LANES - 1) / LANES; }

static inline Node *node_at(Work *w, Int number) { return number < 0 ? &w->base : w->node + number; }

#endif
