//! The same bits on other machines: other instructions, another byte order, floating-point numbers in software.
//!
//! The emitted C of every elementary function runs under emulation on special and random numbers. Each machine prints a hash of the results, which
//! must equal that of the interpreter.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use rsm_core::number::Precision;
use rsm_tests::backend::{Backend, Reference};
use rsm_tests::cases;
use rsm_tests::compilers::{self, Compiler};
use rsm_tests::points::Number;

use super::{folder, points, unit};
use crate::inlined::is_there;

/// Numbers for each function. In software, as on the microcontroller, a number takes some 10,000 instructions.
const COUNT: usize = 4000;

fn numbers() -> Vec<f64> {
    points(1).into_iter().take(COUNT).collect()
}

/// FNV-1a (Fowler, Noll, Vo) by words; a NaN has any bits.
fn hash<T: Number>(results: &[T], bits: impl Fn(T) -> u64) -> u64 {
    results.iter().fold(0xcbf2_9ce4_8422_2325, |hash, it| {
        let bits = if it.wide().is_nan() { 1 } else { bits(*it) };
        (hash ^ bits).wrapping_mul(0x0100_0000_01b3)
    })
}

/// A line for each function: its name and the hash of its results.
fn wanted() -> Vec<String> {
    let (unit, numbers) = (unit(), numbers());
    let line = |function: &rsm_core::emit::Function| {
        let hash = match function.tape.precision {
            Precision::F64 => hash(&Backend::<f64>::evaluate(&Reference, &unit, function, &numbers), f64::to_bits),
            Precision::F32 => {
                let numbers: Vec<f32> = numbers.iter().map(|it| *it as f32).collect();
                hash(&Backend::<f32>::evaluate(&Reference, &unit, function, &numbers), |it| u64::from(it.to_bits()))
            }
        };
        format!("{} {hash:016x}", function.rust_name())
    };
    unit.functions.iter().map(line).collect()
}

/// The emitted sources, and a program that prints what [`wanted`] gives.
fn write_program(folder: &Path) {
    let unit = unit();
    compilers::write_c([&unit], folder);
    let mut text = String::from("#include <stddef.h>\n#include <stdint.h>\n#include <stdio.h>\n#include <string.h>\n\n");
    writeln!(text, "#define COUNT {COUNT}\nstatic const uint64_t numbers[COUNT] = {{").expect("text");
    for number in numbers() {
        writeln!(text, "    {:#x}u,", number.to_bits()).expect("text");
    }
    text.push_str(
        "};\nstatic double x64[COUNT], y64[COUNT];\nstatic float x32[COUNT], y32[COUNT];\n\n\
         static void print(const char *name, size_t count, int is_double)\n{\n    uint64_t hash = 0xcbf29ce484222325u;\n    size_t i;\n    \
         for (i = 0; i < count; i++) {\n        uint64_t bits = 1;\n        uint32_t narrow;\n        \
         if (is_double) {\n            if (y64[i] == y64[i]) { memcpy(&bits, &y64[i], sizeof bits); }\n        \
         } else if (y32[i] == y32[i]) {\n            memcpy(&narrow, &y32[i], sizeof narrow);\n            bits = narrow;\n        }\n        \
         hash = (hash ^ bits) * 0x100000001b3u;\n    }\n    \
         printf(\"%s %08lx%08lx\\n\", name, (unsigned long)(hash >> 32), (unsigned long)(hash & 0xffffffffu));\n}\n\n",
    );
    let mut calls = String::new();
    for function in &unit.functions {
        let (name, arity) = (function.rust_name(), function.inputs.len());
        let (float, width) = if function.tape.precision == Precision::F64 { ("double", "64") } else { ("float", "32") };
        writeln!(text, "void batch_elementary_{name}(const {float} *x, {float} *y, size_t n);").expect("text");
        let is_double = u8::from(width == "64");
        writeln!(
            calls,
            "    batch_elementary_{name}(x{width}, y{width}, COUNT / {arity});\n    print(\"{name}\", COUNT / {arity}, {is_double});"
        )
        .expect("text");
    }
    writeln!(
        text,
        "\nint main(void)\n{{\n    size_t i;\n    for (i = 0; i < COUNT; i++) {{\n        memcpy(&x64[i], &numbers[i], sizeof x64[i]);\n        \
         x32[i] = (float)x64[i];\n    }}\n{calls}    return 0;\n}}"
    )
    .expect("text");
    compilers::write(folder, "main.c", &text);
}

fn printed(command: &mut Command, what: &str) -> Vec<String> {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{what}: {}\n{}", output.status, String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("ASCII").lines().map(str::to_string).collect()
}

/// Compiles for a machine with Linux and runs it under emulation.
fn on(machine: &str, emulator: &str, packages: &str, options: &[&str]) {
    let compiler = format!("{machine}-gcc");
    if !is_there(&[&compiler, emulator], packages) {
        return;
    }
    let folder = folder(&format!("elementary-{machine}"));
    write_program(&folder);
    for options in options {
        let line = format!("{compiler} -static {options}");
        Compiler::new(&line).must(&["models.c", "batches.c", "main.c", "-o", "program"], &folder);
        assert_eq!(printed(Command::new(emulator).arg(folder.join("program")), &line), wanted(), "{line}");
    }
}

/// Fused operations in every machine of the kind, on which the compiler puts products and sums by itself.
#[test]
fn on_aarch64_elementary_functions_have_the_same_bits() {
    let packages = "gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user";
    on("aarch64-linux-gnu", "qemu-aarch64", packages, &["-O0", "-O3", "-O3 -flto -ffp-contract=fast"]);
    if !is_there(&["aarch64-linux-gnu-gcc", "qemu-aarch64"], packages) {
        return;
    }
    // Without the barrier between products and sums the compiler fuses, and the hashes differ.
    let folder = folder("elementary-fused");
    write_program(&folder);
    let line = "aarch64-linux-gnu-gcc -static -O3 -ffp-contract=fast -DRSM_BARRIER(product)=(product)";
    Compiler::new(line).must(&["models.c", "batches.c", "main.c", "-o", "program"], &folder);
    assert_ne!(printed(Command::new("qemu-aarch64").arg(folder.join("program")), line), wanted());
}

/// 32-bit Arm with double precision in hardware, with fused operations.
#[test]
fn on_arm_elementary_functions_have_the_same_bits() {
    let packages = "gcc-arm-linux-gnueabihf libc6-dev-armhf-cross qemu-user";
    on("arm-linux-gnueabihf", "qemu-arm", packages, &["-O2", "-O3 -march=armv7-a -mfpu=vfpv4-d16 -ffp-contract=fast"]);
}

/// Moves of bits between the two sets of registers are instructions of their own; fused operations.
#[test]
fn on_riscv_elementary_functions_have_the_same_bits() {
    let packages = "gcc-riscv64-linux-gnu libc6-dev-riscv64-cross qemu-user";
    on("riscv64-linux-gnu", "qemu-riscv64", packages, &["-O2", "-O3 -ffp-contract=fast"]);
}

/// The other byte order; fused operations.
#[test]
fn on_s390x_elementary_functions_have_the_same_bits() {
    let packages = "gcc-s390x-linux-gnu libc6-dev-s390x-cross qemu-user";
    on("s390x-linux-gnu", "qemu-s390x", packages, &["-std=gnu11 -O2", "-std=gnu11 -O3 -ffp-contract=fast"]);
}

/// A microcontroller: double precision in software, single precision in hardware.
#[test]
fn on_a_cortex_m4f_elementary_functions_have_the_same_bits() {
    if !is_there(&["arm-none-eabi-gcc", "qemu-system-arm"], "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm") {
        return;
    }
    let folder = folder("elementary-m4f");
    write_program(&folder);
    let board = cases::root().join("targets").join("firmware").join("qemu");
    let (script, startup) = (format!("-T{}", board.join("mps2-an386.ld").display()), board.join("startup.c"));
    let line = "arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 -O2 -ffunction-sections -nostartfiles --specs=rdimon.specs -Wl,--gc-sections";
    let startup = startup.display().to_string();
    Compiler::new(line).must(&[&script, "models.c", "batches.c", "main.c", &startup, "-o", "program"], &folder);
    let mut qemu = Command::new("qemu-system-arm");
    qemu.args(["-machine", "mps2-an386", "-nographic", "-monitor", "none", "-serial", "none"]);
    qemu.args(["-semihosting-config", "enable=on,target=native", "-kernel"]).arg(folder.join("program"));
    assert_eq!(printed(&mut qemu, line), wanted(), "{line}");
}
