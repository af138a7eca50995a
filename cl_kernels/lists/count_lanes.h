/*
 * lists/count_lanes.h: how many rays of a box are covered by a narrow triangle, for one work-item
 * to a tile: what lists/count_covered.h counts, RAY_LANES neighbours at a time.
 */
static inline void count_lanes(Sink *sink, const Facet f, const int4 box)
{
    const int2 p = box.xy << STEP_BITS;
    const long wa = (long)(f.c.x - f.b.x) * (p.y - f.b.y) - (long)(f.c.y - f.b.y) * (p.x - f.b.x);
    const long wb = (long)(f.a.x - f.c.x) * (p.y - f.c.y) - (long)(f.a.y - f.c.y) * (p.x - f.c.x);
    const long wc = (long)(f.b.x - f.a.x) * (p.y - f.a.y) - (long)(f.b.y - f.a.y) * (p.x - f.a.x);
    const uint8 lane = (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    const int width = FAST_OF(box.z - box.x, box.w - box.y);
    const int height = SLOW_OF(box.z - box.x, box.w - box.y);
    __local uint *first_row = sink->next + (SLOW_OF(box.x, box.y) - sink->slow) * TILE_WIDE
                            + (FAST_OF(box.x, box.y) - sink->fast);
    Lanes first = lanes_at(f, wa, wb, wc);
    for (int right = 0; right <= width; right += RAY_LANES) {
        /* 1 where the sum is negative. */
        const uint8 within = (lane + (uint)(right - width - 1)) >> 31;
        Lanes at = first;
        __local uint *row = first_row + right;
        for (int rows = height; rows >= 0; --rows, row += TILE_WIDE) {
            vstore8(vload8(0, row) + (covered_lanes(at) & within), 0, row);
            step_slow(&at);
        }
        step_fast(&first);
    }
}
