/* Values that two interrupts of one processor hand over without tearing: two slots, and an index that is written last.
 *
 * In: a value of any struct, from one writer. Out: the newest whole value, for one reader. Neither waits, loops or masks interrupts.
 *
 * The reader interrupts the writer: it sees the index before or after, and the slot that the index names is whole either way. The writer interrupts the
 * reader: it writes the other slot. Only a writer that comes twice in one reading reaches the slot that is read; so the writer's period must be longer than
 * a reading, some ten instructions, with everything that interrupts it. There is no memory barrier of the processor: one core sees its own writes in order.
 */
#ifndef HANDOVER_H
#define HANDOVER_H

#include "exact.h"

/* The compiler moves no access to memory across it. */
#define HANDOVER_IN_ORDER() __asm__ volatile("" : : : "memory")

/* The type NAME, NAME_put for the writer, NAME_take for the reader. */
#define HANDOVER(name, type)                                            \
    typedef struct {                                                    \
        type slots[2];                                                  \
        volatile uint32_t newest;                                       \
    } name;                                                             \
    EXACT_INLINE void name##_put(name *shared, const type *value)       \
    {                                                                   \
        const uint32_t next = shared->newest ^ 1u;                      \
        shared->slots[next] = *value;                                   \
        HANDOVER_IN_ORDER();                                            \
        shared->newest = next;                                          \
    }                                                                   \
    EXACT_INLINE type name##_take(const name *shared)                   \
    {                                                                   \
        const uint32_t newest = shared->newest;                         \
        type value;                                                     \
        HANDOVER_IN_ORDER();                                            \
        value = shared->slots[newest & 1u];                             \
        HANDOVER_IN_ORDER();                                            \
        return value;                                                   \
    }

#endif
