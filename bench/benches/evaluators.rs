//! Nanoseconds per evaluation of the six surfaces, by criterion: latency of a dependent chain and throughput, in f64 and f32, of the interpreter, the
//! emitted Rust, the emitted C without and with clamping, and hand-written nested Horner in C. Without the file of the surfaces it says so and times
//! nothing.

use std::cell::RefCell;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use rsm_bench::horner::{self, Arguments};
use rsm_bench::timed::{Mode, Program, Timed, interpret};
use rsm_bench::{surfaces, toolchain};
use rsm_core::emit::Unit;
use rsm_core::model::Outside;
use rsm_core::number::Precision;
use rsm_core::{compile, emit};

fn evaluators(criterion: &mut Criterion) {
    let peers = surfaces::peers_or_none();
    if peers.is_empty() {
        return;
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("timed");
    let unit = |outside| {
        let unit = |peer: &surfaces::PeerSurface| {
            compile::unit(&peer.checked(outside), &Precision::ALL).expect("both precisions hold it")
        };
        peers.iter().map(unit).collect::<Vec<Unit>>()
    };
    let (plain, clamped) = (unit(Outside::Extrapolate), unit(Outside::Clamp));

    // The functions stand in the same order in all programs: surface by surface, f64 before f32.
    let timed = |units: &[Unit], call: &dyn Fn(&Unit, &emit::Function) -> String| -> Vec<Timed> {
        let all = units.iter().flat_map(|unit| unit.functions.iter().map(move |function| (unit, function)));
        all.map(|(unit, function)| Timed {
            call: call(unit, function),
            inputs: function.inputs.clone(),
            precision: function.tape.precision,
        })
        .collect()
    };
    let c_program = |name: &str, units: &[Unit]| {
        let folder = folder.join(name);
        let mut sources = Vec::new();
        for unit in units {
            let files = emit::c::emit(unit);
            toolchain::write(&folder, &format!("{}.h", unit.model), &files.header);
            toolchain::write(&folder, &format!("{}.c", unit.model), &files.source);
            sources.push(format!("{}.c", unit.model));
        }
        Program::c(&folder, &sources, &timed(units, &|unit, function| function.c_name(&unit.model)))
    };
    let by_hand = |unit: &Unit, function: &emit::Function| format!("horner_{}_{}", unit.model, function.tape.precision.name());
    let text: String = peers
        .iter()
        .zip(&plain)
        .flat_map(|(peer, unit)| {
            let function = |function: &emit::Function| {
                horner::function(&by_hand(unit, function), Arguments::Values, &peer.model, function.tape.precision)
            };
            unit.functions.iter().map(function).collect::<Vec<_>>()
        })
        .collect();
    toolchain::write(&folder.join("horner"), "horner.c", &text);
    let programs = [
        (
            "rust",
            Program::rust(
                &folder.join("rust"),
                &plain,
                &timed(&plain, &|unit, f| format!("{}::{}", unit.model, f.rust_name())),
            ),
        ),
        ("c", c_program("c", &plain)),
        ("c_clamped", c_program("c_clamped", &clamped)),
        ("horner", Program::c(&folder.join("horner"), &["horner.c".to_string()], &timed(&plain, &by_hand))),
    ]
    .map(|(name, program)| (name, RefCell::new(program)));

    let functions = plain.iter().flat_map(|unit| unit.functions.iter().map(move |function| (unit, function)));
    for (k, (unit, function)) in functions.enumerate() {
        let mut group = criterion.benchmark_group(unit.model.to_uppercase());
        for mode in Mode::ALL {
            let precision = function.tape.precision;
            let id = |name: &str| format!("{}_{}_{name}", mode.name(), precision.name());
            let tape = &function.tape;
            group.bench_function(id("interpreter"), |bencher| {
                bencher.iter_custom(|count| match precision {
                    Precision::F64 => interpret(tape, &function.inputs, mode, count, f64::from_bits),
                    Precision::F32 => interpret(tape, &function.inputs, mode, count, |bits| f32::from_bits(bits as u32)),
                });
            });
            for (name, program) in &programs {
                group.bench_function(id(name), |bencher| {
                    bencher.iter_custom(|count| program.borrow_mut().time(k, mode, count));
                });
            }
        }
        group.finish();
    }
}

criterion_group!(benches, evaluators);
criterion_main!(benches);
