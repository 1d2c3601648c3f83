//! The tools that the tests need beside cargo.
//!
//! In: nothing. Out: all of them installed, or the names of the missing Debian packages. Installs them if this user may: as root, or through sudo
//! without a password. Searches for the tools themselves, so a machine with another system passes if it has them.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A program or file whose presence shows that a package is installed, and the package.
const NEEDED: [(&str, &str); 22] = [
    ("gcc", "gcc"),
    ("clang", "clang"),
    ("valgrind", "valgrind"),
    ("objdump", "binutils"),
    ("/usr/include/stdio.h", "libc6-dev"),
    // The firmware on an emulated Cortex-M4F.
    ("arm-none-eabi-gcc", "gcc-arm-none-eabi"),
    ("/usr/lib/arm-none-eabi/lib/rdimon.specs", "libnewlib-arm-none-eabi"),
    ("qemu-system-arm", "qemu-system-arm"),
    // The firmware in Rust: a compiler with the sources of `core` for another machine.
    ("/usr/bin/rustc", "rustc-web"),
    ("/usr/lib/rustlib/src/rust/library/core/Cargo.toml", "rust-web-src"),
    ("/usr/lib/rustlib/x86_64-unknown-linux-gnu/lib", "libstd-rust-web-dev"),
    // Self-tests on emulated AArch64 and 32-bit Arm.
    ("aarch64-linux-gnu-gcc", "gcc-aarch64-linux-gnu"),
    ("/usr/aarch64-linux-gnu/include/stdio.h", "libc6-dev-arm64-cross"),
    ("qemu-aarch64", "qemu-user"),
    ("arm-linux-gnueabihf-gcc", "gcc-arm-linux-gnueabihf"),
    ("/usr/arm-linux-gnueabihf/include/stdio.h", "libc6-dev-armhf-cross"),
    // Elementary functions on two more machines.
    ("riscv64-linux-gnu-gcc", "gcc-riscv64-linux-gnu"),
    ("/usr/riscv64-linux-gnu/include/stdio.h", "libc6-dev-riscv64-cross"),
    ("s390x-linux-gnu-gcc", "gcc-s390x-linux-gnu"),
    ("/usr/s390x-linux-gnu/include/stdio.h", "libc6-dev-s390x-cross"),
    // The wheels of HELICS and of Dask.
    ("pip3", "python3-pip"),
    // The pages of reports, opened and clicked through.
    ("chromium", "chromium"),
];

/// Ensures that all tools are installed.
pub(crate) fn ensure() -> Result<(), String> {
    let missing = missing();
    if missing.is_empty() {
        println!("all present: {}", NEEDED.map(|(_, package)| package).join(" "));
        return Ok(());
    }
    let list = missing.join(" ");
    let Some(apt_get) = apt_get() else {
        return Err(format!("missing: {list}; install them (Debian: apt-get install --no-install-recommends {list})"));
    };
    println!("installing {list}");
    apt(&apt_get, &["update", "-q"])?;
    let install = ["install", "-q", "-y", "--no-install-recommends"];
    apt(&apt_get, &[&install[..], &missing[..]].concat())?;
    let still = self::missing();
    if still.is_empty() { Ok(()) } else { Err(format!("installed, but still not found: {}", still.join(" "))) }
}

fn missing() -> Vec<&'static str> {
    NEEDED.iter().filter(|(file, _)| !is_there(file)).map(|(_, package)| *package).collect()
}

/// A program on the search path, or a file by its absolute name.
fn is_there(file: &str) -> bool {
    if Path::new(file).is_absolute() {
        return Path::new(file).exists();
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder: PathBuf| folder.join(file).is_file())
}

/// The words before the arguments of apt-get, or `None` if this user may not install.
fn apt_get() -> Option<Vec<&'static str>> {
    if !is_there("apt-get") {
        return None;
    }
    let succeeds = |program: &str, arguments: &[&str]| {
        Command::new(program).args(arguments).stderr(Stdio::null()).output().is_ok_and(|output| output.status.success())
    };
    let id = Command::new("id").arg("-u").output().ok()?;
    if id.stdout.trim_ascii() == b"0" {
        Some(vec!["apt-get"])
    } else if is_there("sudo") && succeeds("sudo", &["-n", "true"]) {
        Some(vec!["sudo", "-n", "apt-get"])
    } else {
        None
    }
}

fn apt(apt_get: &[&str], arguments: &[&str]) -> Result<(), String> {
    let mut command = Command::new(apt_get[0]);
    command.args(&apt_get[1..]).args(arguments).env("DEBIAN_FRONTEND", "noninteractive");
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("apt-get {} ended with {status}", arguments.join(" "))),
        Err(error) => Err(format!("cannot start apt-get: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_found_on_the_path_and_a_made_up_one_is_not() {
        assert!(is_there("sh") && is_there("/bin/sh"));
        assert!(!is_there("no-such-program-of-ours") && !is_there("/no/such/file"));
    }
}
