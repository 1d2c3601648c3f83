//! Emitted names: all of them are built and rejected here.
//!
//! In: the names of a model file. Out: the names of functions in C and in Rust, or the reason why a name cannot be emitted, as a clause that follows
//! the quoted name ("`while` is a keyword of ..."). The checker adds the place. Names are never changed.

pub mod plant;
mod reserved;

use crate::number::Precision;
use reserved::{FAMILIES, FLOAT_FAMILIES, INTEGER_ENDINGS, INTEGER_FAMILIES, KEYWORDS, LIBRARY, MACRO_FAMILIES, MACROS};

/// Suffixes that emitters, now or later, append to the name of a surface or a compensator. Two names must not become equal through them.
const SUFFIXES: &[&str] = &[
    "",
    "_f32",
    "_q",
    "_support",
    "_support_f32",
    "_support_q",
    "_state",
    "_state_f32",
    "_state_q",
    "_init",
    "_init_f32",
    "_init_q",
    "_step",
    "_step_f32",
    "_step_q",
    "_self_test",
];

/// The kind of function for which a name is built.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// The surface itself.
    Surface,
    /// The test whether the data support the surface at a point.
    Support,
    /// One step of a compensator.
    Step,
    /// The derivatives of the surface with respect to its inputs.
    Gradient,
    /// The surface without its clamps.
    Inside,
    /// The part of the surface without clamps that depends only on the rarely changed inputs.
    Once,
    /// One step of recursive least squares: the surface follows a measured response.
    Update,
    /// The surface with the coefficients that the updates found.
    Adapted,
}

/// The name of a function in Rust, within the module of the model.
#[must_use]
pub(crate) fn rust_function(surface: &str, kind: Kind, precision: Precision) -> String {
    let kind = match kind {
        Kind::Surface => "",
        Kind::Support => "_support",
        Kind::Step => "_step",
        Kind::Gradient => "_gradient",
        Kind::Inside => "_inside",
        Kind::Once => "_once",
        Kind::Update => "_update",
        Kind::Adapted => "_adapted",
    };
    format!("{surface}{kind}{}", suffix(precision))
}

fn suffix(precision: Precision) -> &'static str {
    match precision {
        Precision::F64 => "",
        Precision::F32 => "_f32",
    }
}

/// The name of the Rust function that creates a compensator's state.
#[must_use]
pub fn rust_init(compensator: &str, precision: Precision) -> String {
    format!("{compensator}_init{}", suffix(precision))
}

/// The name of the Rust type of a compensator's state: `tip_in` has `TipInState`, and `TipInStateF32`.
#[must_use]
pub fn rust_state(compensator: &str, precision: Precision) -> String {
    let precision = match precision {
        Precision::F64 => "",
        Precision::F32 => "F32",
    };
    format!("{}State{precision}", camel_case(compensator))
}

fn camel_case(name: &str) -> String {
    let capital = |word: &str| word[..1].to_ascii_uppercase() + &word[1..];
    name.split('_').filter(|word| !word.is_empty()).map(capital).collect()
}

/// The name of the C function that creates a compensator's state.
#[must_use]
pub fn c_init(model: &str, compensator: &str, precision: Precision) -> String {
    format!("{model}_{}", rust_init(compensator, precision))
}

/// The name of the C type of a compensator's state.
#[must_use]
pub fn c_state(model: &str, compensator: &str, precision: Precision) -> String {
    format!("{model}_{compensator}_state{}", suffix(precision))
}

/// The name of a function in C.
#[must_use]
pub fn c_function(model: &str, surface: &str, kind: Kind, precision: Precision) -> String {
    format!("{model}_{}", rust_function(surface, kind, precision))
}

/// The name of the self-test of a model in C.
#[must_use]
pub(crate) fn c_self_test(model: &str) -> String {
    format!("{model}_self_test")
}

/// The reason why a name (of a model, an input, a surface, a compensator) cannot be emitted; `None` if it can.
///
/// ```
/// use rsm_core::names;
///
/// assert_eq!(names::refuse("torque"), None);
/// assert!(names::refuse("while").unwrap().contains("keyword"));
/// ```
#[must_use]
pub fn refuse(name: &str) -> Option<String> {
    not_an_identifier(name)
        .or_else(|| reserved_form(name))
        .or_else(|| keyword(name))
        .or_else(|| is_macro(name).then(|| "is replaced by the headers or the compilers of C; choose another name".to_string()))
        .or_else(|| register(name))
}

/// The reason why a model cannot have this name; `None` if it can.
#[must_use]
pub fn refuse_model(name: &str) -> Option<String> {
    let family = || {
        FAMILIES
            .contains(&name)
            .then(|| format!("makes C names that begin with `{name}_`, which the C library reserves for its own functions"))
    };
    refuse(name).or_else(family)
}

/// The reason why a surface or a compensator of this model cannot have this name; `None` if it can.
#[must_use]
pub fn refuse_function(model: &str, name: &str) -> Option<String> {
    refuse(name)
        .or_else(|| self_test(name))
        .or_else(|| SUFFIXES.iter().find_map(|suffix| library(&format!("{model}_{name}{suffix}"))))
}

/// The reason why two surfaces or compensators of one model, or two inputs, cannot have these names; `None` if they can.
#[must_use]
pub fn clash(earlier: &str, later: &str) -> Option<String> {
    if earlier == later {
        return Some("is given twice".to_string());
    }
    if earlier.eq_ignore_ascii_case(later) {
        return Some(format!("differs from `{earlier}` only in case"));
    }
    None
}

/// The reason why two surfaces or compensators of one model cannot have these names: [`clash`], and the suffixes of their functions. `None` if they
/// can.
#[must_use]
pub fn clash_of_functions(earlier: &str, later: &str) -> Option<String> {
    clash(earlier, later).or_else(|| {
        let functions = |name: &str| SUFFIXES.iter().map(|suffix| format!("{name}{suffix}")).collect::<Vec<_>>();
        let of_earlier = functions(earlier);
        let same = |name: &String| of_earlier.iter().any(|other| other.eq_ignore_ascii_case(name));
        let common = functions(later).into_iter().find(same)?;
        Some(format!("and `{earlier}` would both have a function `{common}`"))
    })
}

/// The reason why two compensators of one model cannot have these names: the Rust types of their states. `None` if they can.
#[must_use]
pub(crate) fn clash_of_states(earlier: &str, later: &str) -> Option<String> {
    let (of_earlier, of_later) = (camel_case(earlier), camel_case(later));
    of_earlier
        .eq_ignore_ascii_case(&of_later)
        .then(|| format!("and `{earlier}` would both have a type `{}` in Rust", rust_state(later, Precision::F64)))
}

/// The reason why an input of a compensator cannot have this name: the step has an argument with it. `None` if it can.
#[must_use]
pub(crate) fn refuse_scheduled(name: &str) -> Option<String> {
    [SIGNAL, STATE].contains(&name).then(|| "is the name of another argument of its step; choose another name".to_string())
}

/// The name of the array of derivatives among the arguments of a gradient in C: `gradient`, unless an input has that name.
#[must_use]
pub(crate) fn gradient_argument(inputs: &[String]) -> &'static str {
    if inputs.iter().any(|input| input == "gradient") { "gradient_out" } else { "gradient" }
}

/// The name of the array of results among the arguments of an update in C: `update`, unless an input has that name.
#[must_use]
pub(crate) fn update_argument(inputs: &[String]) -> &'static str {
    if inputs.iter().any(|input| input == "update") { "update_out" } else { "update" }
}

/// The reason why an input of a surface that follows measured responses cannot have this name. `None` if it can.
#[must_use]
pub(crate) fn refuse_tracked(name: &str) -> Option<String> {
    [MEASURED, STATE].contains(&name).then(|| "has the name of another argument of the update; rename the input".to_string())
}

/// The reason why an update of a surface cannot be emitted: two functions, or two types of a state, would have the same name. `functions` are the
/// surfaces and compensators of the model, `states` those of them that have a state. `None` if they can.
#[must_use]
pub(crate) fn clash_of_updates(surface: &str, functions: &[&str], states: &[&str]) -> Option<String> {
    let of_functions = || {
        let find = |kind| clash_of_kind(&[surface], functions, kind, "update").map(|(_, why)| why);
        [Kind::Update, Kind::Adapted].into_iter().find_map(find)
    };
    let of_states = || states.iter().filter(|other| **other != surface).find_map(|other| clash_of_states(other, surface));
    of_functions().or_else(of_states)
}

/// The reason why the gradients of a model's surfaces cannot be emitted: two functions would have the same name. `None` if they can.
#[must_use]
pub(crate) fn clash_of_gradients<'n>(surfaces: &[&'n str], functions: &[&'n str]) -> Option<(&'n str, String)> {
    clash_of_kind(surfaces, functions, Kind::Gradient, "gradient")
}

/// The same for the parts without clamps; see [`clash_of_gradients`].
#[must_use]
pub(crate) fn clash_of_parts<'n>(surfaces: &[&'n str], functions: &[&'n str]) -> Option<(&'n str, String)> {
    [Kind::Inside, Kind::Once].into_iter().find_map(|kind| clash_of_kind(surfaces, functions, kind, "part without clamps"))
}

fn clash_of_kind<'n>(surfaces: &[&'n str], functions: &[&'n str], kind: Kind, what: &str) -> Option<(&'n str, String)> {
    for surface in surfaces {
        for function in Precision::ALL.map(|precision| rust_function(surface, kind, precision)) {
            let all = |name: &str| SUFFIXES.iter().any(|suffix| format!("{name}{suffix}").eq_ignore_ascii_case(&function));
            if let Some(other) = functions.iter().find(|other| all(other)) {
                return Some((surface, format!("its {what} and `{other}` would both have a function `{function}`")));
            }
        }
    }
    None
}

/// The name of the signal among the arguments; the checker keeps it free.
pub const SIGNAL: &str = "input";

/// The name of the measured response among the arguments of an update.
pub const MEASURED: &str = "measured";

/// The name of the state among the arguments of a step.
pub(crate) const STATE: &str = "state";

/// The name of the outputs among the arguments of a plant's step in C.
pub const OUTPUTS: &str = "outputs";

fn not_an_identifier(name: &str) -> Option<String> {
    if name.is_empty() {
        return Some("is empty; a name is a letter, then letters, digits and underscores".to_string());
    }
    if let Some(strange) = name.chars().find(|c| !(c.is_ascii_alphanumeric() || *c == '_')) {
        let strange = strange.escape_debug();
        return Some(format!("contains `{strange}`; a name is an ASCII letter, then ASCII letters, digits and underscores"));
    }
    name.starts_with(|c: char| c.is_ascii_digit()).then(|| "begins with a digit; a name begins with a letter".to_string())
}

fn reserved_form(name: &str) -> Option<String> {
    if name.starts_with('_') {
        return Some("begins with an underscore, which C reserves for the compiler".to_string());
    }
    if name.ends_with('_') {
        return Some(
            "ends with an underscore, which would give a double underscore in C; C++ reserves those for the compiler"
                .to_string(),
        );
    }
    if name.contains("__") {
        return Some("contains a double underscore, which C++ reserves for the compiler".to_string());
    }
    let lower = name.to_ascii_lowercase();
    (lower == "rsm" || lower.starts_with("rsm_"))
        .then(|| "begins with `rsm`, which emitted code reserves for its own helpers".to_string())
}

/// Whether a compiler, or a header that emitted C includes, may define a macro with this name. `tests/all/names.rs` tests this with compilers.
fn is_macro(name: &str) -> bool {
    let without_width = |stem: &str| stem.trim_end_matches(|c: char| c.is_ascii_digit()).to_string();
    let of_floats = name.split_once('_').is_some_and(|(stem, _)| FLOAT_FAMILIES.contains(&without_width(stem).as_str()));
    let of_integers = name
        .rsplit_once('_')
        .is_some_and(|(stem, end)| INTEGER_ENDINGS.contains(&end) && INTEGER_FAMILIES.contains(&without_width(stem).as_str()));
    MACROS.contains(&name) || of_floats || of_integers
}

fn keyword(name: &str) -> Option<String> {
    let languages: Vec<&str> =
        KEYWORDS.iter().filter(|(_, words)| words.contains(&name)).map(|(language, _)| *language).collect();
    (!languages.is_empty()).then(|| format!("is a keyword of {}", languages.join(" and ")))
}

fn register(name: &str) -> Option<String> {
    let digits = name.strip_prefix('r')?;
    let all_digits = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    all_digits.then(|| "is the name of a register in emitted code (r0, r1, ...); choose another name".to_string())
}

fn self_test(name: &str) -> Option<String> {
    let lower = name.to_ascii_lowercase();
    (lower == "self_test").then(|| "is the name of the self-test in emitted C; choose another name".to_string())
}

/// A message if a complete C name belongs to the library.
fn library(name: &str) -> Option<String> {
    let fixed_width = name.ends_with("_t") && {
        let stem = name.trim_end_matches("_t").trim_start_matches('u');
        let stem = stem.strip_prefix("int").unwrap_or(" ");
        let width = stem.trim_start_matches("_least").trim_start_matches("_fast");
        width.bytes().all(|byte| byte.is_ascii_digit()) || width == "ptr" || width == "max"
    };
    let in_capitals = !name.bytes().any(|byte| byte.is_ascii_lowercase());
    let macro_family = in_capitals && name.split_once('_').is_some_and(|(prefix, _)| MACRO_FAMILIES.contains(&prefix));
    let known = fixed_width || macro_family || LIBRARY.contains(&name) || keyword(name).is_some();
    known.then(|| format!("makes the C name `{name}`, which the language or its library reserves"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_named_alike_in_both_languages() {
        assert_eq!(rust_function("s", Kind::Support, Precision::F32), "s_support_f32");
        assert_eq!(c_function("m", "s", Kind::Support, Precision::F32), "m_s_support_f32");
        assert_eq!(rust_function("s", Kind::Gradient, Precision::F32), "s_gradient_f32");
        assert_eq!(c_function("m", "s", Kind::Gradient, Precision::F64), "m_s_gradient");
        assert_eq!(gradient_argument(&["torque".to_string()]), "gradient");
        assert_eq!(gradient_argument(&["torque".to_string(), "gradient".to_string()]), "gradient_out");
        assert_eq!(c_function("m", "s", Kind::Surface, Precision::F64), "m_s");
        assert_eq!(c_self_test("m"), "m_self_test");
    }

    #[test]
    fn a_compensator_names_its_state_and_its_functions() {
        assert_eq!(rust_function("tip_in", Kind::Step, Precision::F32), "tip_in_step_f32");
        assert_eq!(rust_init("tip_in", Precision::F64), "tip_in_init");
        assert_eq!(
            (rust_state("tip_in", Precision::F64).as_str(), rust_state("K", Precision::F32).as_str()),
            ("TipInState", "KStateF32")
        );
        assert_eq!(c_init("m", "k", Precision::F32), "m_k_init_f32");
        assert_eq!(c_state("m", "k", Precision::F32), "m_k_state_f32");
        assert!(clash_of_states("tip_in", "tipIn").is_some() && clash_of_states("tip_in", "tip").is_none());
        assert!(
            refuse_scheduled("input").is_some() && refuse_scheduled("state").is_some() && refuse_scheduled("gear").is_none()
        );
    }

    #[test]
    fn ordinary_names_pass() {
        for name in ["torque", "i_q", "psi_d", "Kf", "x1", "r", "R1", "rs", "resm", "raw", "current_advance", "r1a", "time"] {
            assert_eq!(refuse(name), None, "{name}");
            assert_eq!(refuse_model(name), None, "{name}");
            assert_eq!(refuse_function("pmac", name), None, "{name}");
        }
    }

    #[test]
    fn each_rule_refuses_with_its_reason() {
        let cases = [
            ("", "is empty"),
            ("i q", "contains ` `"),
            ("\u{b5}", "contains `\u{b5}`"),
            ("new\nline", "contains `\\n`"),
            ("2nd", "begins with a digit"),
            ("_x", "begins with an underscore"),
            ("x_", "ends with an underscore"),
            ("a__b", "contains a double underscore"),
            ("RSM_x", "begins with `rsm`"),
            ("while", "is a keyword of Rust and C"),
            ("gen", "is a keyword of Rust"),
            ("restrict", "is a keyword of C"),
            ("xor", "is a keyword of C++"),
            ("linux", "is replaced by"),
            ("r17", "is the name of a register"),
        ];
        for (name, reason) in cases {
            let found = refuse(name).unwrap_or_else(|| panic!("`{name}` passed"));
            assert!(found.starts_with(reason), "`{name}` {found}");
        }
    }

    #[test]
    fn a_model_and_a_surface_do_not_make_a_name_of_the_library() {
        assert!(refuse_model("pthread").is_some());
        for (model, surface) in [
            ("int8", "t"),
            ("uint_least16", "t"),
            ("size", "t"),
            ("static", "cast"),
            ("and", "eq"),
            ("M", "PI"),
            ("FLT", "MAX"),
            ("m", "self_test"),
            ("m", "Self_Test"),
        ] {
            assert!(refuse_function(model, surface).is_some(), "{model} {surface}");
        }
        assert_eq!(refuse_function("M", "torque"), None);
        assert_eq!(refuse_function("kettle", "t"), None);
    }

    #[test]
    fn names_that_meet_through_a_suffix_or_in_case_clash() {
        assert_eq!(clash("a", "a"), Some("is given twice".to_string()));
        assert_eq!(clash("Torque", "torque"), Some("differs from `Torque` only in case".to_string()));
        assert_eq!(clash("a", "a_f32"), None);
        for (earlier, later) in
            [("a", "a_f32"), ("a_q", "a"), ("A", "a_support"), ("a", "a_step"), ("a_support", "a"), ("a", "a_init")]
        {
            assert!(clash_of_functions(earlier, later).is_some(), "{earlier} {later}");
        }
        assert_eq!(clash_of_functions("psi_d", "psi_q"), None);
        assert_eq!(clash_of_functions("a", "a_f32"), Some("and `a` would both have a function `a_f32`".to_string()));
    }
}
