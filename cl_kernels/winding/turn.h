/*
 * winding/turn.h: the whole angle of a plane, and half that of space.
 */
#ifndef CLVOX_TURN_H
#define CLVOX_TURN_H

#define TURN 6.28318530718f

#endif
