//! The programs of `targets/firmware`, compiled: for this host, and for a Cortex-M4F under emulation.
//!
//! In: a compiler line and a program. Out: what it printed, its objects, its sizes. Sources are compiled where they are; the evaluators are emitted
//! into a scratch folder from the same coefficient files that the Rust steps include.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rsm_core::check::Checked;
use rsm_core::compile::{self, Parts};
use rsm_core::emit::c_plant;
use rsm_core::emit::plant::Plant;
use rsm_core::number::Precision;
use rsm_core::source::Source;
use rsm_tests::cases;
use rsm_tests::compilers::{self, Compiler};

/// The coefficient files of the models that the steps use.
const MODELS: [&str; 3] =
    ["generated/coefficients/circle.toml", "generated/coefficients/motor.toml", "generated/coefficients/driveline.toml"];

/// The sources. Those of the steps include the evaluators.
pub const OBJECTS: [&str; 3] = ["motor_step", "throttle_step", "tables"];

/// Both loops as interrupts. Its programs have the functions of a board.
pub const IMAGE: &str = "image";

/// What the firmware is compiled with; contraction is as the compiler has it, which is on. Beside each object stands what its functions take of the
/// stack.
pub const CORTEX_M4F: &str =
    "arm-none-eabi-gcc -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 -ffunction-sections -fstack-usage";

/// An instruction takes 64 ns: the timer's tick of 40 ns is shorter.
pub const SLOW: &str = "shift=6";

/// An instruction takes 1 ns: a period of 0.1 ms has room for a plant in software double precision.
pub const FAST: &str = "shift=0";

/// `targets/firmware`.
pub fn firmware() -> PathBuf {
    cases::root().join("targets").join("firmware")
}

fn folder(name: &str) -> PathBuf {
    let folder = compilers::fresh(Path::new(env!("CARGO_TARGET_TMPDIR")), name);
    for model in MODELS {
        let read = Source::read(&cases::root().join(model)).and_then(|source| Checked::read(&source));
        let checked = read.unwrap_or_else(|faults| panic!("{faults}"));
        // The motor's step keeps to the ranges itself.
        let parts = match checked.model().name.as_str() {
            "motor" => Parts { inside: true, once: vec!["current".to_string()], ..Parts::default() },
            _ => Parts::default(),
        };
        let unit = compile::unit_with_parts(&checked, &[Precision::F32], &parts).unwrap_or_else(|faults| panic!("{faults}"));
        compilers::write_c([&unit], &folder);
    }
    folder
}

/// The tools of the emulated board. Without them a test is skipped and prints a message; in continuous integration it fails.
pub fn emulated() -> bool {
    let there = |program: &str| Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success());
    let missing: Vec<&str> =
        [("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi"), ("qemu-system-arm", "qemu-system-arm")]
            .into_iter()
            .filter(|(program, _)| !there(program))
            .map(|(_, packages)| packages)
            .collect();
    if missing.is_empty() {
        return true;
    }
    let what = format!("NOT TESTED on a Cortex-M4F: apt-get install --no-install-recommends {}", missing.join(" "));
    assert!(std::env::var_os("CI").is_none_or(|value| value != "true"), "{what}");
    eprintln!("{what}");
    false
}

/// One set of compiler options, in a folder of its own, with its object files.
pub struct Build {
    folder: PathBuf,
    compiler: Compiler,
    /// Where the sources of the image and of the programs are.
    sources: PathBuf,
    /// Further objects that programs are linked with.
    further: Vec<String>,
}

impl Build {
    /// Compiles every source.
    pub fn new(line: &str, name: &str) -> Build {
        let build = Build {
            folder: folder(&format!("firmware-{name}")),
            compiler: Compiler::new(line),
            sources: firmware(),
            further: vec![],
        };
        for object in OBJECTS {
            build.compile(&firmware().join(format!("{object}.c")), object);
        }
        build
    }

    /// Adds the image.
    pub fn with_image(mut self) -> Build {
        self.compile_image();
        self.further.push(IMAGE.to_string());
        self
    }

    /// Its object alone, without linking a program.
    pub fn compile_image(&self) {
        self.compile(&self.sources.join("image.c"), IMAGE);
    }

    /// Adds the image with another `handover.h`, from copies of everything that includes it.
    pub fn with_image_and(mut self, handover: &str, program: &str) -> Build {
        let copies = self.folder.join("copies");
        std::fs::create_dir_all(copies.join("programs")).expect("the folder can be made");
        let program = format!("programs/{program}.c");
        for file in ["image.h", "image.c", program.as_str()] {
            std::fs::copy(firmware().join(file), copies.join(file)).expect("a copy");
        }
        compilers::write(&copies, "handover.h", handover);
        self.sources = copies;
        self.with_image()
    }

    /// Adds plants as code.
    pub fn with_plants(mut self, plants: &[&Plant]) -> Build {
        for plant in plants {
            let (files, name) = (c_plant::emit(plant), plant.model.clone());
            compilers::write(&self.folder, &format!("{name}.h"), &files.header);
            compilers::write(&self.folder, &format!("{name}.c"), &files.source);
            self.compile(&self.folder.join(format!("{name}.c")), &name);
            self.further.push(name);
        }
        self
    }

    fn compile(&self, source: &Path, object: &str) {
        let (source, object) = (source.display().to_string(), format!("{object}.o"));
        let include = |folder: &Path| format!("-I{}", folder.display());
        let (own, loops, board) = (include(&self.sources), include(&firmware()), include(&firmware().join("qemu")));
        self.compiler.must(&["-I.", &own, &loops, &board, "-c", &source, "-o", &object], &self.folder);
    }

    fn link(&self, program: &str, extra: &[&str]) {
        self.compile(&self.sources.join("programs").join(format!("{program}.c")), program);
        let further = self.further.iter().map(String::as_str);
        let mut objects: Vec<String> =
            OBJECTS.into_iter().chain(further).chain([program]).map(|object| format!("{object}.o")).collect();
        objects.extend(["-lm", "-o", program].map(str::to_string));
        let arguments: Vec<&str> = extra.iter().copied().chain(objects.iter().map(String::as_str)).collect();
        self.compiler.must(&arguments, &self.folder);
    }

    /// Links a program for this host and runs it: its lines.
    pub fn on_host(&self, program: &str) -> Vec<String> {
        self.link(program, &[]);
        lines(&mut Command::new(self.folder.join(program)))
    }

    /// Links a program for this host and runs it on these bytes: what it wrote.
    pub fn on_host_with(&self, program: &str, input: &[u8]) -> Vec<u8> {
        self.link(program, &[]);
        let mut child = Command::new(self.folder.join(program))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut stdin = child.stdin.take().expect("it was piped");
        // A thread feeds it, so that neither pipe can fill up and stop both.
        std::thread::scope(|scope| {
            scope.spawn(move || stdin.write_all(input).expect("the program reads"));
            let output = child.wait_with_output().expect("the program ends");
            assert!(output.status.success(), "{program}: {}", output.status);
            output.stdout
        })
    }

    /// Links a program for the emulated board and runs it there: its lines.
    pub fn on_board(&self, program: &str) -> Vec<String> {
        self.on_board_at(program, SLOW)
    }

    /// The same at a given speed.
    pub fn on_board_at(&self, program: &str, speed: &str) -> Vec<String> {
        let board = firmware().join("qemu");
        self.compile(&board.join("startup.c"), "startup");
        let script = format!("-T{}", board.join("mps2-an386.ld").display());
        self.link(program, &["-nostartfiles", "--specs=rdimon.specs", "-Wl,--gc-sections", &script, "startup.o"]);
        emulate(&self.folder.join(program), speed)
    }

    /// A program that was linked.
    pub fn program(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Bytes of stack that a function takes, without what it calls. Bounded for every input, or this fails.
    pub fn stack(&self, object: &str, function: &str) -> u32 {
        let text = std::fs::read_to_string(self.folder.join(format!("{object}.su"))).expect("gcc wrote it");
        let of_function = |line: &&str| line.split('\t').next().is_some_and(|place| place.ends_with(&format!(":{function}")));
        let line = text.lines().find(of_function).unwrap_or_else(|| panic!("{object}.su has no {function}: {text}"));
        let words: Vec<&str> = line.split('\t').collect();
        assert_eq!(words[2], "static", "{line}");
        words[1].parse().expect("a number")
    }

    /// An object file.
    pub fn object(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.o"))
    }
}

/// Runs a program on the emulated board: its lines.
pub fn emulate(program: &Path, speed: &str) -> Vec<String> {
    emulate_with(program, speed, "")
}

/// The same, with a word on the command line that the program sees.
pub fn emulate_with(program: &Path, speed: &str, word: &str) -> Vec<String> {
    let word = if word.is_empty() { String::new() } else { format!(",arg=program,arg={word}") };
    let mut qemu = Command::new("qemu-system-arm");
    qemu.args(["-machine", "mps2-an386", "-nographic", "-monitor", "none", "-serial", "none", "-icount", speed]);
    qemu.args(["-semihosting-config", &format!("enable=on,target=native{word}"), "-kernel"]).arg(program);
    lines(&mut qemu)
}

/// The lines that a command prints.
pub fn lines(command: &mut Command) -> Vec<String> {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}\n{said}", output.status);
    String::from_utf8(output.stdout).expect("the programs print ASCII").lines().map(str::to_string).collect()
}

/// Disassembly of a Cortex-M object: the lines of each function, relocations as lines of their own.
pub fn cortex_functions(object: &Path) -> Vec<(String, Vec<String>)> {
    let listing = lines(Command::new("arm-none-eabi-objdump").args(["-d", "-r", "--no-show-raw-insn"]).arg(object));
    let mut functions: Vec<(String, Vec<String>)> = vec![];
    for line in listing {
        if let Some(name) = line.strip_suffix(">:").and_then(|line| line.split_once(" <")) {
            functions.push((name.1.to_string(), vec![]));
        } else if let (Some((_, lines)), Some((_, text))) = (functions.last_mut(), line.split_once(":\t")) {
            lines.push(text.trim().to_string());
        } else if let (Some((_, lines)), Some((_, text))) = (functions.last_mut(), line.split_once(": R_ARM_THM_CALL\t")) {
            lines.push(format!("-> {}", text.trim()));
        } else if let (Some((_, lines)), Some((_, text))) = (functions.last_mut(), line.split_once(": R_ARM_THM_JUMP24\t")) {
            // A function with the same code as another is a jump to it; that function is checked too.
            if text.contains("_f32") {
                lines.pop();
            }
            lines.push(format!("-> {}", text.trim()));
        }
    }
    functions
}

/// Disassembly of a linked program: the instructions of each function, with their addresses. Constants between them are left out.
pub fn cortex_instructions(program: &Path) -> Vec<(String, Vec<(u32, String)>)> {
    let listing = lines(Command::new("arm-none-eabi-objdump").args(["-d", "--no-show-raw-insn"]).arg(program));
    let mut functions: Vec<(String, Vec<(u32, String)>)> = vec![];
    for line in listing {
        if let Some(name) = line.strip_suffix(">:").and_then(|line| line.split_once(" <")) {
            functions.push((name.1.to_string(), vec![]));
        } else if let (Some((_, lines)), Some((address, text))) = (functions.last_mut(), line.split_once(":\t"))
            && !text.starts_with(".word")
        {
            let address = u32::from_str_radix(address.trim(), 16).expect("an address");
            lines.push((address, text.trim().to_string()));
        }
    }
    functions
}

/// Bytes of code and constants, and of variables, of an object: `text` and `data + bss` of `size`.
pub fn cortex_size(object: &Path) -> (u32, u32) {
    let listing = lines(Command::new("arm-none-eabi-size").arg(object));
    let numbers: Vec<u32> = listing[1].split_whitespace().take(3).map(|word| word.parse().expect("a number")).collect();
    (numbers[0], numbers[1] + numbers[2])
}

/// Bytes of one section of an object.
pub fn cortex_section(object: &Path, section: &str) -> u32 {
    let listing = lines(Command::new("arm-none-eabi-size").arg("-A").arg(object));
    let size = listing.iter().find_map(|line| line.strip_prefix(section)?.split_whitespace().next()?.parse().ok());
    size.unwrap_or_else(|| panic!("{} has no section {section}: {listing:?}", object.display()))
}
