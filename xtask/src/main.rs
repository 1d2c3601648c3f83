//! Developer commands: test, bench, bless.

fn main() {}
