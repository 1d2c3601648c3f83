//! What C needs so that a tape keeps its bits and has no branch: refusals of what cannot be survived, and one idiom per machine.
//!
//! In: which operations a unit uses, in which precision. Out: text for the head of the source file. The counts below are of gcc 12 and
//! clang 14 at -O2, read from object code; `tests/all/object_code.rs` reads it again.
//!
//! | idiom | x86-64 | x86-64 with AVX | AArch64 | Arm with VFP | RISC-V with D, masks |
//! | --- | --- | --- | --- | --- | --- |
//! | clamp at one bound, the load of the bound included | 2 | 2 | 2 or 3 | 5 | 11 to 13 |
//! | select | 5 | 2 | 2 | 5 | 10 |
//! | keep a product | 0 | 0 | 0 | 0 | 0 |
//!
//! Why not the plain conditional: gcc sees that a clamped value is a constant on one side and makes a branch of it, on every machine.

use crate::number::Precision;

/// Which helpers a precision needs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Needs {
    pub keep: bool,
    pub absolute: bool,
    pub at_least: bool,
    pub at_most: bool,
    pub select: bool,
}

impl Needs {
    fn any_choice(self) -> bool {
        self.at_least || self.at_most || self.select
    }
}

/// Refuses to compile where the results would have other bits. `f64_only`: there is nothing to fall back to without a 64-bit double.
pub(super) fn refusals(file: &str, f64_functions: bool, f32_functions: bool) -> String {
    let mut text = REFUSE_FAST_MATH.replace("FILE", file);
    if f64_functions {
        if !f32_functions {
            text.push_str(&REFUSE_NARROW_DOUBLE.replace("FILE", file));
        }
        text.push_str(&REFUSE_EXCESS_F64.replace("FILE", file));
    }
    if f32_functions {
        text.push_str(&REFUSE_EXCESS_F32.replace("FILE", file));
    }
    text.push_str(CONTRACTION_OFF);
    text
}

/// The macros that say which machine this is; every helper below asks them.
pub(super) fn machine(needs: &[Needs]) -> String {
    let mut text = String::new();
    if needs.iter().any(|needs| needs.keep || needs.any_choice()) {
        text.push_str(MACHINE);
    }
    if needs.iter().any(|needs| needs.keep) {
        text.push_str(BARRIER);
    }
    // f64 with VFP and f32 without may stand in one file: the masks are there whenever a choice is.
    if needs.iter().any(|needs| needs.any_choice() || needs.absolute) {
        text.push_str(COPY);
    }
    text
}

/// The helpers of one precision.
pub(super) fn helpers(needs: Needs, precision: Precision) -> String {
    let mut text = String::new();
    let mut put = |wanted: bool, template: &str| {
        if wanted {
            text.push_str(&fill(template, precision));
        }
    };
    put(needs.keep, KEEP);
    put(needs.absolute, ABSOLUTE);
    put(needs.any_choice(), CHOOSE);
    put(needs.select, SELECT);
    put(needs.at_least, AT_LEAST);
    put(needs.at_most, AT_MOST);
    text
}

/// Writes the type, the suffixes and the register classes of a precision into a template.
fn fill(template: &str, precision: Precision) -> String {
    let words: [(&str, &str, &str); 12] = [
        ("@type", "double", "float"),
        ("@name", "f64", "f32"),
        ("@NAME", "F64", "F32"),
        ("@bits", "uint64_t", "uint32_t"),
        ("@fabs", "fabs", "fabsf"),
        ("@s", "sd", "ss"),
        ("@p", "pd", "ps"),
        ("@a", "%d", "%s"),
        ("@v", "%P", "%"),
        ("@fp", "8", "4"),
        ("@w", "w", "t"),
        ("@length", "64", "32"),
    ];
    let mut text = template.to_string();
    for (word, f64_form, f32_form) in words {
        text = text.replace(word, if precision == Precision::F64 { f64_form } else { f32_form });
    }
    text
}

const REFUSE_FAST_MATH: &str = r#"
/* What cannot be survived does not compile. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(__ASSOCIATIVE_MATH__) \
    || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__) || defined(_M_FP_FAST)
#error "FILE: -ffast-math, -Ofast and the options that they are made of change the results; compile this file without them"
#endif
"#;

const REFUSE_NARROW_DOUBLE: &str = r#"
#if DBL_MANT_DIG != 53 || DBL_MAX_EXP != 1024
#error "FILE: double is not IEEE 754 binary64 here; emit the model in f32 or in fixed point"
#endif
"#;

const REFUSE_EXCESS_F64: &str = r#"
#if defined(__FLT_EVAL_METHOD__)
#if __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 1
#error "FILE: the x87 unit rounds twice; compile this file with -msse2 -mfpmath=sse, or for a machine without excess precision"
#endif
#elif defined(FLT_EVAL_METHOD)
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 1
#error "FILE: the compiler keeps excess precision in double; compile this file without it"
#endif
#endif

/* Fails to compile under -fsingle-precision-constant. */
#ifndef RSM_CONSTANTS_ARE_DOUBLE
#define RSM_CONSTANTS_ARE_DOUBLE
typedef char rsm_constants_are_double[sizeof(1.0) == sizeof(double) ? 1 : -1];
#endif
"#;

const REFUSE_EXCESS_F32: &str = r#"
#if FLT_MANT_DIG != 24 || FLT_MAX_EXP != 128
#error "FILE: float is not IEEE 754 binary32 here"
#endif
#if defined(__FLT_EVAL_METHOD__)
#if __FLT_EVAL_METHOD__ != 0
#error "FILE: float is evaluated with excess precision; compile with -msse2 -mfpmath=sse on x86, -fexcess-precision=fast on s390x"
#endif
#elif defined(FLT_EVAL_METHOD)
#if FLT_EVAL_METHOD != 0
#error "FILE: the compiler keeps excess precision in float; compile this file without it"
#endif
#endif
"#;

// gcc does not know the pragma (and warns of it); clang does not heed it under -ffp-contract=fast. Both have the barrier instead.
const CONTRACTION_OFF: &str = r"
#if defined(_MSC_VER) && !defined(__clang__)
#pragma fp_contract(off)
#elif !defined(__GNUC__) || defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif
";

const MACHINE: &str = r"
/* Which machine this is. RSM_REGISTER is the register class of a number, for empty assembly that a compiler cannot look through. */
#ifndef RSM_MACHINE
#define RSM_MACHINE
#if !defined(__GNUC__)
#define RSM_ISO_C
#elif defined(__SSE2_MATH__)
#define RSM_SSE
#elif defined(__aarch64__)
#define RSM_AARCH64
#elif defined(__arm__) && defined(__ARM_FP)
#define RSM_VFP __ARM_FP
#endif
#ifndef RSM_VFP
#define RSM_VFP 0
#endif
#endif
";

const BARRIER: &str = r"
#if !defined(RSM_BARRIER) && defined(__has_builtin)
#if __has_builtin(__builtin_assoc_barrier)
#define RSM_BARRIER(product) __builtin_assoc_barrier(product)
#endif
#endif
";

const COPY: &str = r"
#ifndef RSM_COPY
#if defined(__GNUC__)
#define RSM_COPY(to, from) ((void)__builtin_memcpy((to), (from), sizeof *(to)))
#else
#include <string.h>
#define RSM_COPY(to, from) ((void)memcpy((to), (from), sizeof *(to)))
#endif
#endif
";

// Also on products that feed no sum here: a caller into which the function is inlined may add to its result. And on arguments: the
// caller's product may not be fused into the first difference.
const KEEP: &str = r#"
/* A product as IEEE 754 rounds it: no compiler may fuse it into a sum, whatever its options. It costs no instruction. */
#ifndef RSM_KEEP_@NAME
#define RSM_KEEP_@NAME
#if defined(RSM_BARRIER)
#define rsm_keep_@name(product) RSM_BARRIER(product)
#elif defined(RSM_ISO_C)
#define rsm_keep_@name(product) (product)
#else
static inline @type rsm_keep_@name(@type product)
{
#if defined(RSM_SSE)
    __asm__("" : "+x"(product));
#elif defined(RSM_AARCH64)
    __asm__("" : "+w"(product));
#elif RSM_VFP & @fp
    __asm__("" : "+@w"(product));
#elif defined(__riscv_flen) && __riscv_flen >= @length
    __asm__("" : "+f"(product));
#elif defined(__arm__) || defined(__riscv) || defined(__AVR__)
    __asm__("" : "+r"(product));
#else
    __asm__("" : "+m"(product));
#endif
    return product;
}
#endif
#endif
"#;

const ABSOLUTE: &str = r"
/* Clears the sign bit. */
#ifndef RSM_ABSOLUTE_@NAME
#define RSM_ABSOLUTE_@NAME
static inline @type rsm_absolute_@name(@type value)
{
#if defined(__GNUC__)
    return __builtin_@fabs(value);
#else
    @bits bits;
    RSM_COPY(&bits, &value);
    bits &= ~((@bits)1 << (@length - 1));
    RSM_COPY(&value, &bits);
    return value;
#endif
}
#endif
";

// The flag goes through empty assembly: LLVM would make a branch of the mask again on a Cortex-M0.
const CHOOSE: &str = r#"
/* then where the flag is 1, otherwise where it is 0, by masks: machines without an idiom below. */
#ifndef RSM_CHOOSE_@NAME
#define RSM_CHOOSE_@NAME
#if !defined(RSM_SSE) && !defined(RSM_AARCH64) && !(RSM_VFP & @fp)
static inline @type rsm_choose_@name(unsigned int flag, @type then, @type otherwise)
{
    @bits chosen, other, mask;
#if defined(__GNUC__)
    __asm__("" : "+r"(flag));
#endif
    mask = (@bits)0 - (@bits)flag;
    RSM_COPY(&chosen, &then);
    RSM_COPY(&other, &otherwise);
    other ^= (chosen ^ other) & mask;
    RSM_COPY(&otherwise, &other);
    return otherwise;
}
#endif
#endif
"#;

const SELECT: &str = r#"
/* then where left < right, else otherwise, also where either is NaN. */
#ifndef RSM_SELECT_@NAME
#define RSM_SELECT_@NAME
static inline @type rsm_select_@name(@type left, @type right, @type then, @type otherwise)
{
#if defined(RSM_SSE) && defined(__AVX__)
    @type mask, result;
    __asm__("vcmplt@s {%2, %1, %0|%0, %1, %2}" : "=x"(mask) : "x"(left), "x"(right));
    __asm__("vblendv@p {%3, %2, %1, %0|%0, %1, %2, %3}" : "=x"(result) : "x"(otherwise), "x"(then), "x"(mask));
    return result;
#elif defined(RSM_SSE)
    __asm__("cmplt@s {%1, %0|%0, %1}" : "+x"(left) : "x"(right));
    __asm__("and@p {%1, %0|%0, %1}" : "+x"(then) : "x"(left));
    __asm__("andn@p {%1, %0|%0, %1}" : "+x"(left) : "x"(otherwise));
    __asm__("or@p {%1, %0|%0, %1}" : "+x"(then) : "x"(left));
    return then;
#elif defined(RSM_AARCH64)
    @type result;
    __asm__("fcmp @a1, @a2\n\tfcsel @a0, @a3, @a4, mi" : "=w"(result) : "w"(left), "w"(right), "w"(then), "w"(otherwise) : "cc");
    return result;
#elif RSM_VFP & @fp
    __asm__("vcmp.@name @v1, @v2\n\tvmrs APSR_nzcv, fpscr\n\tit mi\n\tvmovmi.@name @v0, @v3"
            : "+@w"(otherwise) : "@w"(left), "@w"(right), "@w"(then) : "cc");
    return otherwise;
#else
    return rsm_choose_@name((unsigned int)(left < right), then, otherwise);
#endif
}
#endif
"#;

const AT_LEAST: &str = r#"
/* bound where value < bound, else value: a NaN passes, and a tie keeps value. */
#ifndef RSM_AT_LEAST_@NAME
#define RSM_AT_LEAST_@NAME
static inline @type rsm_at_least_@name(@type value, @type bound)
{
#if defined(__clang__) && (defined(RSM_SSE) || defined(RSM_AARCH64))
    return value < bound ? bound : value;
#elif defined(RSM_SSE) && defined(__AVX__)
    @type result;
    __asm__("vmax@s {%2, %1, %0|%0, %1, %2}" : "=x"(result) : "x"(bound), "x"(value));
    return result;
#elif defined(RSM_SSE)
    __asm__("max@s {%1, %0|%0, %1}" : "+x"(bound) : "x"(value));
    return bound;
#elif defined(RSM_AARCH64)
    @type result;
    __asm__("fcmp @a1, @a2\n\tfcsel @a0, @a2, @a1, mi" : "=w"(result) : "w"(value), "w"(bound) : "cc");
    return result;
#elif RSM_VFP & @fp
    __asm__("vcmp.@name @v0, @v1\n\tvmrs APSR_nzcv, fpscr\n\tit mi\n\tvmovmi.@name @v0, @v1" : "+@w"(value) : "@w"(bound) : "cc");
    return value;
#else
    return rsm_choose_@name((unsigned int)(value < bound), bound, value);
#endif
}
#endif
"#;

const AT_MOST: &str = r#"
/* bound where bound < value, else value: a NaN passes, and a tie keeps value. */
#ifndef RSM_AT_MOST_@NAME
#define RSM_AT_MOST_@NAME
static inline @type rsm_at_most_@name(@type value, @type bound)
{
#if defined(__clang__) && (defined(RSM_SSE) || defined(RSM_AARCH64))
    return bound < value ? bound : value;
#elif defined(RSM_SSE) && defined(__AVX__)
    @type result;
    __asm__("vmin@s {%2, %1, %0|%0, %1, %2}" : "=x"(result) : "x"(bound), "x"(value));
    return result;
#elif defined(RSM_SSE)
    __asm__("min@s {%1, %0|%0, %1}" : "+x"(bound) : "x"(value));
    return bound;
#elif defined(RSM_AARCH64)
    @type result;
    __asm__("fcmp @a1, @a2\n\tfcsel @a0, @a1, @a2, mi" : "=w"(result) : "w"(bound), "w"(value) : "cc");
    return result;
#elif RSM_VFP & @fp
    __asm__("vcmp.@name @v1, @v0\n\tvmrs APSR_nzcv, fpscr\n\tit mi\n\tvmovmi.@name @v0, @v1" : "+@w"(value) : "@w"(bound) : "cc");
    return value;
#else
    return rsm_choose_@name((unsigned int)(bound < value), bound, value);
#endif
}
#endif
"#;
