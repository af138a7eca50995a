/*
 * lists/count_covered.h: how many rays of a box are covered by a triangle, each counted by itself.
 *
 * What crossings/rasterise.h finds, without depths.  One work-item to a tile counts without a
 * branch, which nobody could foresee; where there are several, their counters are shared.
 *
 * Defines:    EDGE           type of the edge functions: int where they fit (is_narrow), or long
 *             COUNT_COVERED  name of the function
 */
static inline void COUNT_COVERED(Sink *sink, const Facet f, const int4 box)
{
    const int2 ab = f.b.xy - f.a.xy;
    const int2 bc = f.c.xy - f.b.xy;
    const int2 ca = f.a.xy - f.c.xy;
    const int2 p = box.xy << STEP_BITS;
    const long wa = (long)bc.x * (p.y - f.b.y) - (long)bc.y * (p.x - f.b.x);
    const long wb = (long)ca.x * (p.y - f.c.y) - (long)ca.y * (p.x - f.c.x);
    const long wc = (long)ab.x * (p.y - f.a.y) - (long)ab.y * (p.x - f.a.x);
    EDGE row_a = (EDGE)((wa - (edge_owns(bc) ? 0 : 1)) >> STEP_BITS);
    EDGE row_b = (EDGE)((wb - (edge_owns(ca) ? 0 : 1)) >> STEP_BITS);
    EDGE row_c = (EDGE)((wc - (edge_owns(ab) ? 0 : 1)) >> STEP_BITS);
    const EDGE fast_a = FAST_OF(-bc.y, bc.x);
    const EDGE fast_b = FAST_OF(-ca.y, ca.x);
    const EDGE fast_c = FAST_OF(-ab.y, ab.x);
    const int count = FAST_OF(box.z - box.x, box.w - box.y) + 1;
    __local uint *row = sink->next + (SLOW_OF(box.x, box.y) - sink->slow) * TILE_WIDE
                      + (FAST_OF(box.x, box.y) - sink->fast);
    for (int rows = SLOW_OF(box.z - box.x, box.w - box.y); rows >= 0; --rows, row += TILE_WIDE) {
        EDGE ea = row_a;
        EDGE eb = row_b;
        EDGE ec = row_c;
        for (int ray = 0; ray < count; ++ray) {
#if GROUP == 1
            row[ray] += (ea | eb | ec) >= 0;
#else
            if ((ea | eb | ec) >= 0) atomic_inc(row + ray);
#endif
            ea += fast_a;
            eb += fast_b;
            ec += fast_c;
        }
        row_a += SLOW_OF(-bc.y, bc.x);
        row_b += SLOW_OF(-ca.y, ca.x);
        row_c += SLOW_OF(-ab.y, ab.x);
    }
}
