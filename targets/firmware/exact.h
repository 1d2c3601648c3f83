/* Arithmetic and selection in float with one meaning on every machine: the twin of targets/branch-free in C.
 *
 * In: numbers. Out: products that no compiler fuses into a sum, whatever its options, and selections without a branch. On machines with an FPU a
 * bound is four instructions (Cortex-M4F) or one (x86-64). Never calls anything.
 */
#ifndef EXACT_H
#define EXACT_H

#include <stdint.h>

#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__)
#error "-ffast-math and the options that it is made of change the results; compile without them"
#endif
#if !defined(__GNUC__)
#error "the barriers below are written for gcc and clang"
#endif
#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 16
#error "float is evaluated with excess precision here"
#endif

/* Inlined at -Os too, where gcc else makes functions of them: a step is one piece of straight code that calls its evaluators. */
#define EXACT_INLINE __attribute__((always_inline)) static inline

/* Everything that such a function calls is inlined into it, evaluators too: clamps of the same argument are then shared, and nothing is saved around calls. */
#define EXACT_FLATTEN __attribute__((flatten))

/* A product, rounded. gcc in GNU mode fuses by default and ignores the standard pragma: an empty statement on the register holds it off. */
EXACT_INLINE float exact_product(float a, float b)
{
    float product = a * b;
#if defined(__SSE2_MATH__)
    __asm__("" : "+x"(product));
#elif defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    __asm__("" : "+t"(product));
#elif defined(__aarch64__)
    __asm__("" : "+w"(product));
#else
    __asm__("" : "+m"(product));
#endif
    return product;
}

/* then where left < right, else otherwise, also where either is NaN. */
EXACT_INLINE float exact_select(float left, float right, float then, float otherwise)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    __asm__("vcmp.f32 %1, %2\n\tvmrs APSR_nzcv, fpscr\n\tit mi\n\tvmovmi.f32 %0, %3"
            : "+t"(otherwise)
            : "t"(left), "t"(right), "t"(then)
            : "cc");
    return otherwise;
#else
    uint32_t mask = (uint32_t)0 - (uint32_t)(left < right);
    uint32_t chosen, other;
    __asm__("" : "+r"(mask));
    __builtin_memcpy(&chosen, &then, sizeof chosen);
    __builtin_memcpy(&other, &otherwise, sizeof other);
    other ^= (chosen ^ other) & mask;
    __builtin_memcpy(&otherwise, &other, sizeof other);
    return otherwise;
#endif
}

/* Two selections by one comparison: *first becomes then_first and *second then_second where left < right. */
EXACT_INLINE void exact_replace_two(float left, float right, float *first, float then_first, float *second, float then_second)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    float a = *first, b = *second;
    __asm__("vcmp.f32 %2, %3\n\tvmrs APSR_nzcv, fpscr\n\titt mi\n\tvmovmi.f32 %0, %4\n\tvmovmi.f32 %1, %5"
            : "+&t"(a), "+t"(b)
            : "t"(left), "t"(right), "t"(then_first), "t"(then_second)
            : "cc");
    *first = a;
    *second = b;
#else
    *first = exact_select(left, right, then_first, *first);
    *second = exact_select(left, right, then_second, *second);
#endif
}

/* Where not left < right, also where either is NaN: *value becomes otherwise, and *count grows by one. */
EXACT_INLINE void exact_unless(float left, float right, float *value, float otherwise, uint32_t *count, uint32_t one)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    float a = *value;
    uint32_t counted = *count;
    __asm__("vcmp.f32 %2, %3\n\tvmrs APSR_nzcv, fpscr\n\titt pl\n\tvmovpl.f32 %0, %4\n\taddpl %1, %1, %5"
            : "+t"(a), "+r"(counted)
            : "t"(left), "t"(right), "t"(otherwise), "rI"(one)
            : "cc");
    *value = a;
    *count = counted;
#else
    uint32_t mask = (uint32_t)0 - (uint32_t)(left < right);
    __asm__("" : "+r"(mask));
    *value = exact_select(left, right, *value, otherwise);
    *count += one & ~mask;
#endif
}

/* The same for two values, and for three. */
EXACT_INLINE void exact_unless_two(float left, float right, float *first, float other_first, float *second, float other_second, uint32_t *count, uint32_t one)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    float a = *first, b = *second;
    uint32_t counted = *count;
    __asm__("vcmp.f32 %3, %4\n\tvmrs APSR_nzcv, fpscr\n\tittt pl\n\tvmovpl.f32 %0, %5\n\tvmovpl.f32 %1, %6\n\taddpl %2, %2, %7"
            : "+&t"(a), "+t"(b), "+r"(counted)
            : "t"(left), "t"(right), "t"(other_first), "t"(other_second), "rI"(one)
            : "cc");
    *first = a;
    *second = b;
    *count = counted;
#else
    *first = exact_select(left, right, *first, other_first);
    exact_unless(left, right, second, other_second, count, one);
#endif
}

EXACT_INLINE void exact_unless_three(float left, float right, float *first, float other_first, float *second, float other_second, float *third, float other_third, uint32_t *count, uint32_t one)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    float a = *first, b = *second, c = *third;
    uint32_t counted = *count;
    __asm__("vcmp.f32 %4, %5\n\tvmrs APSR_nzcv, fpscr\n\titttt pl\n\tvmovpl.f32 %0, %6\n\tvmovpl.f32 %1, %7\n\tvmovpl.f32 %2, %8\n\taddpl %3, %3, %9"
            : "+&t"(a), "+&t"(b), "+t"(c), "+r"(counted)
            : "t"(left), "t"(right), "t"(other_first), "t"(other_second), "t"(other_third), "rI"(one)
            : "cc");
    *first = a;
    *second = b;
    *third = c;
    *count = counted;
#else
    *first = exact_select(left, right, *first, other_first);
    exact_unless_two(left, right, second, other_second, third, other_third, count, one);
#endif
}

/* Three selections by one comparison: each value becomes what is given for it where left < right. */
EXACT_INLINE void exact_replace_three(float left, float right, float *first, float then_first, float *second, float then_second, float *third, float then_third)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    float a = *first, b = *second, c = *third;
    __asm__("vcmp.f32 %3, %4\n\tvmrs APSR_nzcv, fpscr\n\tittt mi\n\tvmovmi.f32 %0, %5\n\tvmovmi.f32 %1, %6\n\tvmovmi.f32 %2, %7"
            : "+&t"(a), "+&t"(b), "+t"(c)
            : "t"(left), "t"(right), "t"(then_first), "t"(then_second), "t"(then_third)
            : "cc");
    *first = a;
    *second = b;
    *third = c;
#else
    exact_replace_two(left, right, first, then_first, second, then_second);
    *third = exact_select(left, right, then_third, *third);
#endif
}

/* Two selections, and one, where a count has reached most: by whole numbers. */
EXACT_INLINE void exact_replace_two_from(uint32_t count, uint32_t most, float *first, float then_first, float *second, float then_second)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    float a = *first, b = *second;
    __asm__("cmp %2, %3\n\titt cs\n\tvmovcs.f32 %0, %4\n\tvmovcs.f32 %1, %5"
            : "+&t"(a), "+t"(b)
            : "r"(count), "r"(most), "t"(then_first), "t"(then_second)
            : "cc");
    *first = a;
    *second = b;
#else
    uint32_t flag = (uint32_t)(most <= count);
    __asm__("" : "+r"(flag));
    exact_replace_two(0.0f, (float)flag, first, then_first, second, then_second);
#endif
}

EXACT_INLINE float exact_select_from(uint32_t count, uint32_t most, float then, float otherwise)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    __asm__("cmp %1, %2\n\tit cs\n\tvmovcs.f32 %0, %3" : "+t"(otherwise) : "r"(count), "r"(most), "t"(then) : "cc");
    return otherwise;
#else
    uint32_t flag = (uint32_t)(most <= count);
    __asm__("" : "+r"(flag));
    return exact_select(0.0f, (float)flag, then, otherwise);
#endif
}

/* bound where value < bound, else value: a NaN passes, and a tie keeps value. */
EXACT_INLINE float exact_at_least(float value, float bound)
{
#if defined(__SSE2_MATH__) && !defined(__AVX__)
    __asm__("maxss {%1, %0|%0, %1}" : "+x"(bound) : "x"(value));
    return bound;
#else
    return exact_select(value, bound, bound, value);
#endif
}

/* bound where bound < value, else value: a NaN passes, and a tie keeps value. */
EXACT_INLINE float exact_at_most(float value, float bound)
{
#if defined(__SSE2_MATH__) && !defined(__AVX__)
    __asm__("minss {%1, %0|%0, %1}" : "+x"(bound) : "x"(value));
    return bound;
#else
    return exact_select(bound, value, bound, value);
#endif
}

/* Both bounds, the lower one first. */
EXACT_INLINE float exact_within(float value, float low, float high)
{
    return exact_at_most(exact_at_least(value, low), high);
}

/* value without its sign. */
EXACT_INLINE float exact_magnitude(float value)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    /* One instruction; by whole numbers it is three, because the number goes to another register and back. */
    return __builtin_fabsf(value);
#else
    uint32_t bits;
    __builtin_memcpy(&bits, &value, sizeof bits);
    bits &= 0x7FFFFFFFu;
    __builtin_memcpy(&value, &bits, sizeof bits);
    return value;
#endif
}

/* Where the magnitude of *value is not below limit, also where it is NaN: *value becomes otherwise, and *count grows by one. limit is a number, 0 or more: the
 * bits of such numbers, of infinity and of NaN stand in their order as whole numbers. */
EXACT_INLINE void exact_unless_within(float limit, float *value, float otherwise, uint32_t *count)
{
#if defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    uint32_t bits, bound, other, magnitude, counted = *count;
    __builtin_memcpy(&bits, value, sizeof bits);
    __builtin_memcpy(&bound, &limit, sizeof bound);
    __builtin_memcpy(&other, &otherwise, sizeof other);
    magnitude = bits & 0x7FFFFFFFu;
    __asm__("cmp %2, %3\n\titt cs\n\tmovcs %0, %4\n\taddcs %1, %1, #1"
            : "+r"(bits), "+r"(counted)
            : "r"(magnitude), "r"(bound), "r"(other)
            : "cc");
    __builtin_memcpy(value, &bits, sizeof bits);
    *count = counted;
#else
    exact_unless(exact_magnitude(*value), limit, value, otherwise, count, 1u);
#endif
}

#if !(defined(__SSE2_MATH__) || defined(__aarch64__) || (defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4))) || defined(EXACT_ROOT_BY_DIGITS)
/* The square root by whole numbers, for machines without the instruction: root_by_digits of targets/branch-free. */
static inline float exact_root_by_digits(float value)
{
    uint32_t bits, mantissa;
    int32_t exponent, moved, power;
    uint64_t square, root = 0u, bit;
    float scale;
    __builtin_memcpy(&bits, &value, sizeof bits);
    if ((bits << 1) == 0u || bits == 0x7F800000u) {
        return value;
    }
    if (bits > 0x7F800000u) {
        bits = 0x7FC00000u;
        __builtin_memcpy(&value, &bits, sizeof bits);
        return value;
    }
    exponent = (int32_t)(bits >> 23);
    mantissa = bits & 0x007FFFFFu;
    if (exponent == 0) {
        exponent = 1;
    } else {
        mantissa |= 0x00800000u;
    }
    exponent -= 150;
    while (mantissa < 0x00800000u) {
        mantissa <<= 1;
        exponent--;
    }
    moved = 25 + ((exponent + 25) & 1);
    square = (uint64_t)mantissa << moved;
    for (bit = (uint64_t)1u << 24; bit > 0u; bit >>= 1) {
        const uint64_t more = root | bit;
        if (more * more <= square) {
            root = more;
        }
    }
    power = (exponent - moved) / 2 + 1;
    bits = (uint32_t)(power + 127) << 23;
    __builtin_memcpy(&scale, &bits, sizeof bits);
    return (float)((root + 1u) >> 1) * scale;
}
#endif

/* The square root, rounded as IEEE 754 asks: the same bits everywhere. NaN for a NaN and for what is below 0. */
EXACT_INLINE float exact_root(float value)
{
#if defined(EXACT_ROOT_BY_DIGITS)
    return exact_root_by_digits(value);
#elif defined(__SSE2_MATH__)
    float root;
    __asm__("sqrtss {%1, %0|%0, %1}" : "=x"(root) : "x"(value));
    return root;
#elif defined(__aarch64__)
    float root;
    __asm__("fsqrt %s0, %s1" : "=w"(root) : "w"(value));
    return root;
#elif defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & 4)
    float root;
    __asm__("vsqrt.f32 %0, %1" : "=t"(root) : "t"(value));
    return root;
#else
    return exact_root_by_digits(value);
#endif
}

/* 1 with the sign of value. */
EXACT_INLINE float exact_sign(float value)
{
    uint32_t bits;
    __builtin_memcpy(&bits, &value, sizeof bits);
    bits = (bits & 0x80000000u) | 0x3F800000u;
    __builtin_memcpy(&value, &bits, sizeof value);
    return value;
}

/* value with its sign times that of sign. */
EXACT_INLINE float exact_signed(float value, float sign)
{
    uint32_t bits, other;
    __builtin_memcpy(&bits, &value, sizeof bits);
    __builtin_memcpy(&other, &sign, sizeof other);
    bits ^= other & 0x80000000u;
    __builtin_memcpy(&value, &bits, sizeof value);
    return value;
}

/* 0 for a number, NaN for a NaN or an infinity. */
EXACT_INLINE float exact_nothing(float value)
{
    return value - value;
}

/* then where a sum of nothings is of numbers only, else otherwise. */
EXACT_INLINE float exact_if_good(float sum_of_nothings, float then, float otherwise)
{
    return exact_select(sum_of_nothings, 1.0f, then, otherwise);
}

/* 1 where left < right, else 0, also where either is NaN. */
EXACT_INLINE uint32_t exact_less(float left, float right)
{
    return (uint32_t)exact_select(left, right, 1.0f, 0.0f);
}

/* The same bits, of which the compiler knows nothing: what it knows to be 0 or 1 it else makes a branch of. */
EXACT_INLINE uint32_t exact_opaque(uint32_t bits)
{
    __asm__("" : "+r"(bits));
    return bits;
}

/* 1 where a count below 2^31 is not 0, else 0. */
EXACT_INLINE uint32_t exact_any(uint32_t count)
{
    return exact_opaque((uint32_t)0 - count) >> 31;
}

/* How many bad samples there were: all of them, and those in a row that end now. Both stay at the largest number of an int32_t when they get there. */
typedef struct {
    uint32_t all;
    uint32_t in_a_row;
} bad_samples;

EXACT_INLINE uint32_t exact_add_up_to_the_largest(uint32_t count, uint32_t one)
{
    const uint32_t sum = count + one;
    return sum - (one & exact_opaque(sum >> 31));
}

/* The sample is good where faults is 0; faults is below 2^31. */
EXACT_INLINE void bad_samples_add(bad_samples *bad, uint32_t faults)
{
#if defined(__arm__) && defined(__thumb2__) && defined(__ARM_FEATURE_DSP)
    uint32_t all = bad->all, in_a_row = bad->in_a_row;
    __asm__("cmp %2, #0\n\titte ne\n\tqaddne %0, %0, %3\n\tqaddne %1, %1, %3\n\tmoveq %1, #0" : "+&r"(all), "+&r"(in_a_row) : "r"(faults), "r"(1u) : "cc");
    bad->all = all;
    bad->in_a_row = in_a_row;
#else
    const uint32_t one = exact_any(faults);
    bad->all = exact_add_up_to_the_largest(bad->all, one);
    bad->in_a_row = exact_add_up_to_the_largest(bad->in_a_row, one) & ((uint32_t)0 - one);
#endif
}

EXACT_INLINE void bad_samples_count(bad_samples *bad, uint32_t good)
{
    bad_samples_add(bad, good ^ 1u);
}

#endif
