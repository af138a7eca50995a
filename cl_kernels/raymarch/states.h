/*
 * raymarch/states.h: one word for all that a ray must know of a coarse cell.
 *
 * The number of its brick; or, of a cell that is all of one kind, UNIFORM, whether it is inside,
 * and how many cells it is away from one of another kind.  Of blocks of cells only these two are
 * kept, in a byte; 0 for a block that is not all of one kind.
 */
#ifndef CLVOX_STATES_H
#define CLVOX_STATES_H

#define UNIFORM 0xffffff00u
#define INSIDE_STATE 0x80u
#define FREE 0x7fu

#endif
