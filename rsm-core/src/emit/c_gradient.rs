//! The differences in C for a function with several results: an array as the last argument, and its block of the self-test.

use super::c_idioms::{c_type, suffix};
use super::{Function, Kind, Unit, points};
use crate::names;
use crate::number::Precision;

/// The name of the last argument.
fn argument(function: &Function) -> &'static str {
    let inputs = &function.tape.inputs;
    if function.kind == Kind::Update { names::update_argument(inputs) } else { names::gradient_argument(inputs) }
}

/// The last argument.
pub(super) fn array(function: &Function) -> String {
    let (float, name) = (c_type(function.tape.precision), argument(function));
    format!("{float} {name}[{}]", function.tape.outputs.len())
}

/// The last lines of the function.
pub(super) fn end(function: &Function) -> String {
    let name = argument(function);
    let each = function.tape.outputs.iter().enumerate().map(|(k, output)| format!("    {name}[{k}] = {};\n", output.reg));
    format!("{}}}\n", each.collect::<String>())
}

/// Tests the function at points with results of the interpreter: through a volatile pointer, and by name in a loop over arrays, into which the
/// compiler may inline it.
pub(super) fn test_block(unit: &Unit, function: &Function) -> String {
    let tape = &function.tape;
    let points = points::points(function);
    let float = c_type(tape.precision);
    let (bits, end, digits) = match tape.precision {
        Precision::F64 => ("uint64_t", "ULL", 16),
        Precision::F32 => ("uint32_t", "UL", 8),
    };
    let (arity, results, count) = (tape.inputs.len(), tape.outputs.len(), points.len());
    let rows: String = points
        .iter()
        .map(|point| {
            let row = point.arguments.iter().chain(&point.results).map(|bits| format!("0x{bits:0digits$x}{end}"));
            let note = if point.changes_under_fusing { " /* other bits if fused */" } else { "" };
            format!("            {{ {} }},{note}\n", row.collect::<Vec<_>>().join(", "))
        })
        .collect();
    let of = |template: &dyn Fn(usize) -> String, count: usize| (0..count).map(template).collect::<Vec<_>>();
    let (mut types, mut pass, mut state, mut rest) = (String::new(), "", String::new(), String::new());
    if function.has_state() {
        // The points are a sequence with one state.
        let name = function.c_state(&unit.model);
        types = format!("{name} *, ");
        pass = "&state, ";
        state = format!("        {name} state;\n");
        rest = format!("        {}(&state);\n", names::c_init(&unit.model, &function.surface, tape.precision));
    }
    types.push_str(&of(&|_| format!("{float}, "), arity).concat());
    let by_pointer = format!("{pass}{}", of(&|k| format!("x[{k}], "), arity).concat());
    let by_name = format!("{pass}{}", of(&|k| format!("x{k}[k], "), arity).concat());
    let what = if function.kind == Kind::Gradient { "derivatives" } else { "results" };
    let arrays = of(&|k| format!("        {float} x{k}[{count}];\n"), arity).concat();
    let fill = of(&|k| format!("            (void)memcpy(&x{k}[k], &rows[k][{k}], sizeof x{k}[k]);\n"), arity).concat();
    let judged = |value: &str| {
        let differs = format!("{}_rsm_differs{}", unit.model, suffix(tape.precision));
        let each = |j: usize| format!("            failures += {differs}({value}[{j}], points[k][{}]);\n", arity + j);
        of(&each, results).concat()
    };
    format!(
        "    {{\n        \
         /* Bits of the arguments, then of the {what}. */\n        \
         static const {bits} points[][{width}] = {{\n{rows}        }};\n        \
         void (*volatile function)({types}{float} *) = {name};\n        \
         const {bits} (*volatile rows)[{width}] = points;\n        \
         volatile unsigned int count = {count};\n        \
         unsigned int k, n;\n\
         {arrays}        \
         {float} y[{count}][{results}];\n\
         {state}{rest}        \
         for (k = 0; k < {count}; k++) {{\n            \
             {float} x[{arity}], found[{results}];\n            \
             (void)memcpy(x, points[k], sizeof x);\n            \
             function({by_pointer}found);\n\
             {by_pointer_judged}        \
         }}\n        \
         for (k = 0; k < {count}; k++) {{\n{fill}        }}\n\
         {rest}        \
         n = count;\n        \
         for (k = 0; k < n; k++) {{\n            \
             {name}({by_name}y[k]);\n        \
         }}\n        \
         for (k = 0; k < {count}; k++) {{\n\
             {in_loop}        \
         }}\n    \
         }}\n",
        width = arity + results,
        name = function.c_name(&unit.model),
        by_pointer_judged = judged("found"),
        in_loop = judged("y[k]"),
    )
}
