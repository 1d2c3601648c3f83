//! C code that keeps the bits of a tape without a branch: errors for compilers and options that would change results, and one idiom for each machine.
//!
//! In: which operations a unit uses, in which precision. Out: text for the beginning of the source file. The counts below are for gcc 12 and clang 14
//! at -O2, read from object code; `tests/all/object_code.rs` checks them.
//!
//! | idiom | x86-64 | x86-64 with AVX | AArch64 | Arm with VFP | RISC-V with D, masks |
//! | --- | --- | --- | --- | --- | --- |
//! | clamp at one bound, the load of the bound included | 2 | 2 | 3 | 5 | 13 |
//! | select | 4 | 2 | 2 | 5 | 10 |
//! | keep a product that a sum reads | 0 | 0 | 0 | 0 | 0 |
//! | hide a divisor or what is negated, from clang | 0 | 0 | 0 | 0 | 0 |
//!
//! A plain conditional is not suitable. gcc sees that a clamped value is a constant on one side and makes a branch, on every machine. clang does so
//! if a product of the clamped value follows, because a constant times a constant need not be computed.

use crate::number::Precision;

/// The scalar type in C.
pub(super) fn c_type(precision: Precision) -> &'static str {
    match precision {
        Precision::F64 => "double",
        Precision::F32 => "float",
    }
}

/// The suffix of the names of helpers.
pub(super) fn suffix(precision: Precision) -> &'static str {
    match precision {
        Precision::F64 => "",
        Precision::F32 => "_f32",
    }
}

/// The helpers that a precision needs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Needs {
    pub keep: bool,
    pub hide: bool,
    pub absolute: bool,
    pub exponent: bool,
    pub power_of_two: bool,
    pub nearest: bool,
    pub whole: bool,
    pub at_least: bool,
    pub at_most: bool,
    pub select: bool,
}

impl Needs {
    fn any_choice(self) -> bool {
        self.at_least || self.at_most || self.select
    }
}

/// Compiler errors for cases in which the results would have other bits. If double has less than 64 bits, the f32 functions of a file are kept.
pub(super) fn refusals(model: &str, f64_functions: bool, f32_functions: bool) -> String {
    let mut text = REFUSE_FAST_MATH.to_string();
    if f64_functions {
        if !f32_functions {
            text.push_str(REFUSE_NARROW_DOUBLE);
        }
        text.push_str(REFUSE_EXCESS_F64);
    }
    if f32_functions {
        text.push_str(REFUSE_EXCESS_F32);
    }
    text.push_str(PRECISE);
    text.replace("@m", model)
}

/// The macros that identify the machine; every helper below uses them.
pub(super) fn machine(needs: &[Needs]) -> String {
    let mut text = String::new();
    if needs.iter().any(|needs| needs.keep || needs.hide || needs.nearest || needs.whole || needs.any_choice()) {
        text.push_str(MACHINE);
    }
    text
}

/// The helpers of one precision. Their names begin with the model's name, so that the sources of several models can be compiled as one.
pub(super) fn helpers(model: &str, needs: Needs, precision: Precision) -> String {
    let mut text = String::new();
    let mut put = |wanted: bool, template: &str| {
        if wanted {
            let filled = fill(template, precision).replace("@order", IN_ORDER);
            text.push_str(&filled.replace("@m", model));
        }
    };
    put(needs.keep || needs.hide || needs.nearest || needs.whole, KEEP);
    put(needs.hide, HIDE);
    put(needs.absolute, ABSOLUTE);
    put(needs.exponent || needs.power_of_two || needs.whole, COPY);
    put(needs.exponent, EXPONENT);
    put(needs.power_of_two, POWER_OF_TWO);
    put(needs.nearest, NEAREST);
    put(needs.whole, WHOLE);
    put(needs.any_choice(), CHOOSE);
    put(needs.select, SELECT);
    put(needs.at_least, AT_LEAST);
    put(needs.at_most, AT_MOST);
    text
}

/// Inserts the type, the suffixes and the register classes of a precision into a template.
fn fill(template: &str, precision: Precision) -> String {
    let words: [(&str, &str, &str); 18] = [
        // Before @s, because it begins with it.
        ("@suffix", "", "_f32"),
        ("@type", "double", "float"),
        ("@name", "f64", "f32"),
        ("@bits", "uint64_t", "uint32_t"),
        ("@fabs", "fabs", "fabsf"),
        ("@s", "sd", "ss"),
        ("@p", "pd", "ps"),
        ("@a", "%d", "%s"),
        ("@v", "%P", "%"),
        ("@fp", "8", "4"),
        ("@w", "w", "t"),
        ("@digits", "52", "23"),
        ("@field", "0x7ff", "0xff"),
        // 2^52 and 2^23 as bits; with the bias as a number; with the bias and 2^51 or 2^22 more.
        ("@unit", "((uint64_t)0x43300000 << 32)", "(uint32_t)0x4b000000"),
        ("@biased", "4503599627371519.0", "8388735.0f"),
        ("@lifted", "6755399441056767.0", "12583039.0f"),
        ("@length", "64", "32"),
        // 1.5 times 2^52 and 2^23.
        ("@half_up", "6755399441055744.0", "12582912.0f"),
    ];
    let mut text = template.to_string();
    for (word, f64_form, f32_form) in words {
        text = text.replace(word, if precision == Precision::F64 { f64_form } else { f32_form });
    }
    text
}

// With -fno-honor-infinities clang 17 and later declare every argument and result finite (`nofpclass(inf)`). No pragma undoes this and no macro shows
// it: the result of an infinite argument is then undefined. clang 18 and later have a warning, which is made an error here; only -w suppresses it.
// With clang 17 the self-tests find no difference.
const REFUSE_FAST_MATH: &str = r#"
/* What cannot be survived does not compile. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(__ASSOCIATIVE_MATH__) \
    || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__) || defined(_M_FP_FAST)
#error "@m.c: -ffast-math, -Ofast and the options that they are made of change the results; compile this file without them"
#endif
#if defined(__clang__) && defined(__has_warning)
#if __has_warning("-Wnan-infinity-disabled")
#pragma clang diagnostic push
#pragma clang diagnostic error "-Wnan-infinity-disabled"
typedef char @m_rsm_has_infinities[__builtin_isinf(__builtin_inf()) ? 1 : -1]; /* -fno-honor-infinities would change the results */
#pragma clang diagnostic pop
#endif
#endif
"#;

const REFUSE_NARROW_DOUBLE: &str = r#"
#if DBL_MANT_DIG != 53 || DBL_MAX_EXP != 1024
#error "@m.c: double is not IEEE 754 binary64 here; emit the model in f32 or in fixed point"
#endif
"#;

// 16 and 32 concern only _Float16: float and double are evaluated as with 0. gcc gives 16 in GNU mode on x86-64 machines with AVX512-FP16. With 1,
// float is evaluated as double, which does not affect double.
const REFUSE_EXCESS_F64: &str = r#"
#if defined(__FLT_EVAL_METHOD__)
#if __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 1 && __FLT_EVAL_METHOD__ != 16 && __FLT_EVAL_METHOD__ != 32
#error "@m.c: the x87 unit rounds twice; compile this file with -msse2 -mfpmath=sse, or for a machine without excess precision"
#endif
#elif defined(FLT_EVAL_METHOD)
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 1 && FLT_EVAL_METHOD != 16 && FLT_EVAL_METHOD != 32
#error "@m.c: the compiler keeps excess precision in double; compile this file without it"
#endif
#endif

/* Fails to compile under -fsingle-precision-constant. */
typedef char @m_rsm_constants_are_double[sizeof(1.0) == sizeof(double) ? 1 : -1];
"#;

const REFUSE_EXCESS_F32: &str = r#"
#if FLT_MANT_DIG != 24 || FLT_MAX_EXP != 128
#error "@m.c: float is not IEEE 754 binary32 here"
#endif
#if defined(__FLT_EVAL_METHOD__)
#if __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 16 && __FLT_EVAL_METHOD__ != 32
#error "@m.c: float is evaluated with excess precision; compile with -msse2 -mfpmath=sse on x86, -fexcess-precision=fast on s390x"
#endif
#elif defined(FLT_EVAL_METHOD)
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16 && FLT_EVAL_METHOD != 32
#error "@m.c: the compiler keeps excess precision in float; compile this file without it"
#endif
#endif
"#;

// clang shows -funsafe-math-optimizations and its parts to no preprocessor macro. Its pragma float_control disables them, from the first version that
// has it (11) to the last, also in clang 22 with -ffp-model=fast. It is pushed and popped, in case a file is included in another. On targets without
// strict floating point (such as 32-bit Arm) clang ignores it. So each function also forbids reordering of sums, which every target respects.
// Compilers without the barrier get the standard pragma.
const PRECISE: &str = r#"
#if defined(__clang__)
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wignored-pragmas"
#pragma float_control(push)
#pragma float_control(precise, on)
#pragma clang diagnostic pop
#elif defined(__GNUC__)
#if __GNUC__ < 12
#pragma GCC push_options
#pragma GCC optimize ("no-associative-math", "no-reciprocal-math", "signed-zeros", "no-unsafe-math-optimizations", "trapping-math")
#endif
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#else
#pragma STDC FP_CONTRACT OFF
#endif
"#;

/// The last lines of the source: they pop what [`refusals`] pushed.
pub(super) const PRECISE_ENDS: &str = r#"
#if defined(__clang__)
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wignored-pragmas"
#pragma float_control(pop)
#pragma clang diagnostic pop
#elif defined(__GNUC__)
#if __GNUC__ < 12
#pragma GCC pop_options
#endif
#endif
"#;

/// The first lines of a function.
pub(super) const IN_ORDER: &str = "\
#if defined(__clang__)
#pragma clang fp reassociate(off)
#endif
";

const MACHINE: &str = r"
/* Which machine this is: each clamps and selects without a branch in its own way. */
#if !defined(__GNUC__)
#define RSM_ISO_C
#elif defined(__SSE2_MATH__)
#define RSM_SSE
#elif defined(__aarch64__)
#define RSM_AARCH64
#endif
";

// Assembly is used because no compiler pass looks through it. gcc's __builtin_assoc_barrier is treated as a copy and dropped by its vectoriser, so a
// loop with an inlined function had fused operations. gcc's function attributes and option pragmas keep the bits, but then callers with other options
// cannot inline the function, or the options hold for a whole file that includes this one. RSM_BARRIER is for the tests, which remove the barrier to
// see that it is needed.
const KEEP: &str = r#"
/* A product as IEEE 754 rounds it: no compiler may fuse it into a sum, whatever its options, nor when it vectorises a loop around it. */
#if defined(RSM_BARRIER)
#define @m_rsm_keep@suffix(product) RSM_BARRIER(product)
#elif defined(RSM_ISO_C)
#define @m_rsm_keep@suffix(product) (product)
#else
static inline @type @m_rsm_keep@suffix(@type product)
{
#if defined(RSM_SSE)
    __asm__("" : "+x"(product));
#elif defined(RSM_AARCH64)
    __asm__("" : "+w"(product));
#elif defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & @fp)
    __asm__("" : "+@w"(product));
#elif defined(__riscv_flen) && __riscv_flen >= @length
    __asm__("" : "+f"(product));
#elif defined(__arm__) || defined(__riscv) || defined(__AVR__)
    __asm__("" : "+r"(product));
#elif defined(__s390x__) || (defined(__powerpc64__) && !defined(_SOFT_FLOAT) && !defined(__SPE__))
    __asm__("" : "+f"(product));
#else
    __asm__("" : "+m"(product));
#endif
    return product;
}
#endif
"#;

// clang before 22 uses the command-line options for a negation, whatever the pragma says, and so treats -(a - b) + c as a sum that it may reorder.
// Where it ignores the pragma (32-bit Arm), it makes reciprocals of divisors, and 0 of x - x, which tests whether x is finite.
const HIDE: &str = r#"
/* The value; clang does not see where it comes from. */
#if defined(__clang__)
#define @m_rsm_hide@suffix(value) @m_rsm_keep@suffix(value)
#else
#define @m_rsm_hide@suffix(value) (value)
#endif
"#;

const ABSOLUTE: &str = r"
/* Clears the sign bit. */
static inline @type @m_rsm_absolute@suffix(@type value)
{
#if defined(__GNUC__)
    return __builtin_@fabs(value);
#else
    @bits bits;
    (void)memcpy(&bits, &value, sizeof bits);
    bits &= ~((@bits)1 << (@length - 1));
    (void)memcpy(&value, &bits, sizeof value);
    return value;
#endif
}
";

const COPY: &str = r"
#if !defined(RSM_COPY)
#if defined(__GNUC__)
#define RSM_COPY(to, from) ((void)__builtin_memcpy((to), (from), sizeof *(to)))
#else
#define RSM_COPY(to, from) ((void)memcpy((to), (from), sizeof *(to)))
#endif
#endif
";

// 2^52 with the exponent field in its low bits is 2^52 + field. This avoids a conversion between integers and floating-point numbers, which a machine
// without floating point of this width would do by a call.
const EXPONENT: &str = r"
/* The exponent as a number: the field without its bias. */
static inline @type @m_rsm_exponent@suffix(@type value)
{
@order    @bits bits;
    RSM_COPY(&bits, &value);
    bits = ((bits >> @digits) & @field) | @unit;
    RSM_COPY(&value, &bits);
    return value - @biased;
}
";

const POWER_OF_TWO: &str = r"
/* 2 to a whole number, which moves into the place of the exponent. */
static inline @type @m_rsm_power_of_two@suffix(@type value)
{
@order    @type lifted = value + @lifted;
    @bits bits;
    RSM_COPY(&bits, &lifted);
    bits <<= @digits;
    RSM_COPY(&lifted, &bits);
    return lifted;
}
";

// The sum is kept from compilers that would simplify it whatever the pragma says.
const NEAREST: &str = r"
/* The nearest integer, of two the even one: from 2^52, in f32 2^23, a sum is rounded to an integer. */
static inline @type @m_rsm_nearest@suffix(@type value)
{
@order    return @m_rsm_keep@suffix(value + @half_up) - @half_up;
}
";

// No conversion: it would be a call on some machines, and is undefined for a NaN.
const WHOLE: &str = r"
/* The low bits of an integer that is not negative. */
static inline uint32_t @m_rsm_whole@suffix(@type value)
{
@order    const @type lifted = @m_rsm_keep@suffix(value + @half_up);
    @bits bits;
    RSM_COPY(&bits, &lifted);
    return (uint32_t)bits;
}
";

// The flag passes through empty assembly; otherwise LLVM would make a branch of the mask on a Cortex-M0.
const CHOOSE: &str = r#"
/* then where the flag is 1, otherwise where it is 0, by masks: machines without an idiom below. */
#if !defined(RSM_SSE) && !defined(RSM_AARCH64) && !(defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & @fp))
#if defined(__GNUC__)
#define RSM_COPY(to, from) ((void)__builtin_memcpy((to), (from), sizeof *(to)))
#else
#define RSM_COPY(to, from) ((void)memcpy((to), (from), sizeof *(to)))
#endif
static inline @type @m_rsm_choose@suffix(unsigned int flag, @type then, @type otherwise)
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
"#;

const SELECT: &str = r#"
/* then where left < right, else otherwise, also where either is NaN. */
static inline @type @m_rsm_select@suffix(@type left, @type right, @type then, @type otherwise)
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
#elif defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & @fp)
    __asm__("vcmp.@name @v1, @v2\n\tvmrs APSR_nzcv, fpscr\n\tit mi\n\tvmovmi.@name @v0, @v3"
            : "+@w"(otherwise) : "@w"(left), "@w"(right), "@w"(then) : "cc");
    return otherwise;
#else
    return @m_rsm_choose@suffix((unsigned int)(left < right), then, otherwise);
#endif
}
"#;

const AT_LEAST: &str = r#"
/* bound where value < bound, else value: a NaN passes, and a tie keeps value. */
static inline @type @m_rsm_at_least@suffix(@type value, @type bound)
{
#if defined(RSM_SSE) && defined(__AVX__)
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
#elif defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & @fp)
    __asm__("vcmp.@name @v0, @v1\n\tvmrs APSR_nzcv, fpscr\n\tit mi\n\tvmovmi.@name @v0, @v1" : "+@w"(value) : "@w"(bound) : "cc");
    return value;
#else
    return @m_rsm_choose@suffix((unsigned int)(value < bound), bound, value);
#endif
}
"#;

const AT_MOST: &str = r#"
/* bound where bound < value, else value: a NaN passes, and a tie keeps value. */
static inline @type @m_rsm_at_most@suffix(@type value, @type bound)
{
#if defined(RSM_SSE) && defined(__AVX__)
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
#elif defined(__arm__) && defined(__ARM_FP) && (__ARM_FP & @fp)
    __asm__("vcmp.@name @v1, @v0\n\tvmrs APSR_nzcv, fpscr\n\tit mi\n\tvmovmi.@name @v0, @v1" : "+@w"(value) : "@w"(bound) : "cc");
    return value;
#else
    return @m_rsm_choose@suffix((unsigned int)(bound < value), bound, value);
#endif
}
"#;
