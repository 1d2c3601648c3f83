/* The currents by bilinear interpolation in a table over torque and speed, SIDE points a side: what is commonly done, to compare with. */
#include "step.h"

#include "table.h" /* SIDE, table_i_d and table_i_q, written by write_table.c */

current table_currents(float torque, float speed)
{
    const float last = (float)(SIDE - 1);
    float x = (torque < 0.0f ? -torque : torque) * (last / (float)TOP_TORQUE);
    float y = (speed < 0.0f ? -speed : speed) * (last / (float)TOP_SPEED);
    unsigned int column, row, at;
    float right, up, low, high;
    current i;
    if (x > last) {
        x = last;
    }
    if (y > last) {
        y = last;
    }
    column = (unsigned int)x;
    row = (unsigned int)y;
    if (column > SIDE - 2) {
        column = SIDE - 2;
    }
    if (row > SIDE - 2) {
        row = SIDE - 2;
    }
    right = x - (float)column;
    up = y - (float)row;
    at = row * SIDE + column;
    low = table_i_d[at] + right * (table_i_d[at + 1] - table_i_d[at]);
    high = table_i_d[at + SIDE] + right * (table_i_d[at + SIDE + 1] - table_i_d[at + SIDE]);
    i.i_d = low + up * (high - low);
    low = table_i_q[at] + right * (table_i_q[at + 1] - table_i_q[at]);
    high = table_i_q[at + SIDE] + right * (table_i_q[at + SIDE + 1] - table_i_q[at + SIDE]);
    i.i_q = low + up * (high - low);
    if (torque < 0.0f) {
        i.i_q = -i.i_q;
    }
    return i;
}
