/* Prints table.h: the answers of the full controller on a grid. Its argument is the number of points a side. Compiled with -DOPTIMUM_DOUBLE. */
#include <stdio.h>
#include <stdlib.h>

#include "optimum.h"

static double answer(int side, int row, int column, int quadrature)
{
    const double torque = TOP_TORQUE * column / (side - 1), speed = TOP_SPEED * row / (side - 1);
    const optimum o = optimum_currents(torque, speed);
    if (quadrature) {
        return column == 0 ? 0.0 : o.i.i_q;
    }
    return o.i.i_d;
}

int main(int count, char **arguments)
{
    const int side = count == 2 ? atoi(arguments[1]) : 0;
    int quadrature, row, column;
    if (side < 2) {
        fputs("usage: write_table SIDE\n", stderr);
        return 2;
    }
    printf("#define SIDE %du\n", (unsigned int)side);
    for (quadrature = 0; quadrature < 2; quadrature++) {
        printf("static const float table_i_%c[SIDE * SIDE] = {\n", quadrature ? 'q' : 'd');
        for (row = 0; row < side; row++) {
            for (column = 0; column < side; column++) {
                printf("%.9ef,", answer(side, row, column, quadrature));
            }
            puts("");
        }
        puts("};");
    }
    return 0;
}
