/*
 * lists/lanes.h: which rays a narrow triangle covers, RAY_LANES neighbours at a time and no branch.
 *
 * A ray is covered where none of the three edge functions is negative (crossings/rasterise.h).  In
 * units of a voxel they fit an int in the triangle's box and one step beyond; further out they are
 * anything, modulo 2^32, and nobody looks.
 */
#define RAY_LANES 8

/* The edge functions at neighbours along fast, and by how much they change along fast and slow. */
typedef struct {
    uint8 a, b, c;
    uint fast_a, fast_b, fast_c, slow_a, slow_b, slow_c;
} Lanes;

/* w: the edge function of edge d at a ray, times STEP. */
static inline uint floor_edge(const long w, const int2 d)
{
    return (uint)((w - (edge_owns(d) ? 0 : 1)) >> STEP_BITS);
}

/* At the first rays of a box: wa, wb, wc are the edge functions there, times STEP. */
static inline Lanes lanes_at(const Facet f, const long wa, const long wb, const long wc)
{
    const int2 ab = f.b.xy - f.a.xy;
    const int2 bc = f.c.xy - f.b.xy;
    const int2 ca = f.a.xy - f.c.xy;
    const uint8 lane = (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    Lanes at;
    at.fast_a = (uint)FAST_OF(-bc.y, bc.x);
    at.fast_b = (uint)FAST_OF(-ca.y, ca.x);
    at.fast_c = (uint)FAST_OF(-ab.y, ab.x);
    at.slow_a = (uint)SLOW_OF(-bc.y, bc.x);
    at.slow_b = (uint)SLOW_OF(-ca.y, ca.x);
    at.slow_c = (uint)SLOW_OF(-ab.y, ab.x);
    at.a = floor_edge(wa, bc) + lane * at.fast_a;
    at.b = floor_edge(wb, ca) + lane * at.fast_b;
    at.c = floor_edge(wc, ab) + lane * at.fast_c;
    return at;
}

/* 1 for each lane that is covered, else 0. */
static inline uint8 covered_lanes(const Lanes at)
{
    return ~(at.a | at.b | at.c) >> 31;
}

/* The next row of rays. */
static inline void step_slow(Lanes *at)
{
    at->a += at->slow_a;
    at->b += at->slow_b;
    at->c += at->slow_c;
}

/* The next RAY_LANES rays along fast. */
static inline void step_fast(Lanes *at)
{
    at->a += RAY_LANES * at->fast_a;
    at->b += RAY_LANES * at->fast_b;
    at->c += RAY_LANES * at->fast_c;
}
