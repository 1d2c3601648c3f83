//! A linked program of the firmware in Rust: bytes of stack and of flash of a function with all that it calls.
//!
//! In: a program that was compiled with `-Z emit-stack-sizes`. The compiler then writes the frame of each function into the section `.stack_sizes`,
//! as gcc does with `-fstack-usage`; the calls stand in the disassembly. So the bytes are exact: a painted stack does not show the bytes that a frame
//! reserves and never writes, but an interrupt leaves its registers below these too.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use super::builds;

/// A function: its name, frame, bytes in flash, and the functions that it calls, by their addresses.
struct Function {
    name: String,
    frame: u32,
    bytes: u32,
    calls: Vec<u32>,
    /// Calls at its end, when its own frame is gone.
    jumps: Vec<u32>,
}

/// The functions of a program, by their addresses.
pub struct Linked(BTreeMap<u32, Function>);

fn hexadecimal(word: &str) -> u32 {
    u32::from_str_radix(word, 16).unwrap_or_else(|error| panic!("`{word}`: {error}"))
}

/// The section `.stack_sizes`: for each function its address in 4 bytes, then the bytes of its frame in LEB128.
fn frames(program: &Path) -> BTreeMap<u32, u32> {
    let copy = program.with_extension("stack-sizes");
    let mut objcopy = Command::new("arm-none-eabi-objcopy");
    objcopy.args(["-O", "binary", "--only-section=.stack_sizes", "--set-section-flags", ".stack_sizes=alloc"]);
    let status = objcopy.arg(program).arg(&copy).status().expect("objcopy starts");
    assert!(status.success(), "{}: {status}", program.display());
    parse(&std::fs::read(&copy).expect("objcopy wrote it"))
}

fn parse(section: &[u8]) -> BTreeMap<u32, u32> {
    let mut frames = BTreeMap::new();
    let mut bytes = section.iter().copied();
    while let Some(first) = bytes.next() {
        let [second, third, fourth] = [(); 3].map(|()| bytes.next().expect("an address of 4 bytes"));
        let (mut frame, mut shift) = (0, 0);
        loop {
            let byte = bytes.next().expect("the bytes of a frame");
            frame |= u32::from(byte & 0x7F) << shift;
            shift += 7;
            if byte & 0x80 == 0 {
                break;
            }
        }
        frames.insert(u32::from_le_bytes([first, second, third, fourth]), frame);
    }
    frames
}

impl Linked {
    /// Of a program.
    pub fn of(program: &Path) -> Linked {
        let frames = frames(program);
        let sizes: BTreeMap<u32, u32> = builds::lines(Command::new("arm-none-eabi-nm").arg("-S").arg(program))
            .iter()
            .filter_map(|line| {
                let words: Vec<&str> = line.split(' ').collect();
                (words.len() == 4).then(|| (hexadecimal(words[0]), hexadecimal(words[1])))
            })
            .collect();
        let functions = builds::cortex_instructions(program).into_iter().filter_map(|(name, lines)| {
            let (first, _) = *lines.first()?;
            let bytes = *sizes.get(&first)?;
            let (mut calls, mut jumps) = (vec![], vec![]);
            for (_, text) in &lines {
                let mut words = text.split_whitespace();
                let (mnemonic, target) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
                let stem = mnemonic.split('.').next().unwrap_or_default();
                match stem {
                    "bl" => calls.push(hexadecimal(target)),
                    "b" if !(first..first + bytes).contains(&hexadecimal(target)) => jumps.push(hexadecimal(target)),
                    // A call by a register: the function is not known here, and neither are its bytes.
                    "blx" => calls.push(u32::MAX),
                    _ => {}
                }
            }
            // A function in assembly has no frame there. It is an error only if one of the questions needs it.
            let frame = frames.get(&first).copied().unwrap_or(u32::MAX);
            Some((first, Function { name, frame, bytes, calls, jumps }))
        });
        Linked(functions.collect())
    }

    fn at(&self, address: u32) -> &Function {
        let function = self.0.get(&address).unwrap_or_else(|| panic!("no function begins at {address:x}"));
        assert_ne!(function.frame, u32::MAX, "{} has no frame in .stack_sizes", function.name);
        function
    }

    /// The address of the only function whose mangled name contains `part`.
    fn find(&self, part: &str) -> u32 {
        let found: Vec<u32> = self.0.iter().filter(|(_, it)| it.name.contains(part)).map(|(address, _)| *address).collect();
        assert_eq!(found.len(), 1, "functions with `{part}` in their names");
        found[0]
    }

    /// Bytes of stack that a function takes, without what it calls.
    pub fn frame(&self, part: &str) -> u32 {
        self.at(self.find(part)).frame
    }

    /// Bytes of stack of a call: the frame and the largest of what is called.
    pub fn stack(&self, part: &str) -> u32 {
        self.stack_at(self.find(part))
    }

    fn stack_at(&self, address: u32) -> u32 {
        let function = self.at(address);
        let largest = |calls: &[u32]| calls.iter().map(|it| self.stack_at(*it)).max().unwrap_or(0);
        (function.frame + largest(&function.calls)).max(largest(&function.jumps))
    }

    /// Bytes of flash: the function and what it calls, each once. Their constants stand behind their instructions.
    pub fn flash(&self, part: &str) -> u32 {
        let mut all = vec![self.find(part)];
        let mut next = 0;
        while let Some(address) = all.get(next) {
            let function = self.at(*address);
            let more: Vec<u32> = function.calls.iter().chain(&function.jumps).copied().filter(|it| !all.contains(it)).collect();
            all.extend(more);
            next += 1;
        }
        all.sort_unstable();
        all.dedup();
        all.iter().map(|it| self.at(*it).bytes).sum()
    }
}

#[test]
fn frames_and_calls_add_up() {
    assert_eq!(parse(&[0x50, 0x27, 0, 0, 0xA8, 0x01, 0x10, 0x41, 0, 0, 8]), BTreeMap::from([(0x2750, 168), (0x4110, 8)]));
    let function = |name: &str, frame, calls: &[u32], jumps: &[u32]| Function {
        name: name.to_string(),
        frame,
        bytes: 10 * frame,
        calls: calls.to_vec(),
        jumps: jumps.to_vec(),
    };
    // `a` calls `b` twice, and `c`, which ends with a jump to `b`.
    let linked = Linked(BTreeMap::from([
        (1, function("a", 8, &[2, 2, 3], &[])),
        (2, function("b", 40, &[], &[])),
        (3, function("c", 16, &[], &[2])),
    ]));
    assert_eq!((linked.frame("a"), linked.stack("a"), linked.stack("c")), (8, 48, 40));
    assert_eq!((linked.flash("a"), linked.flash("c")), (640, 560));
}
