//! Changed texts: what an editor, a broken export or an attacker makes of a valid file.
//!
//! In: texts that are valid or nearly so, a seed. Out: for each number one text, always the same.

/// Splitmix64 (Steele, Lea, Flood 2014).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to below `bound`, which is above 0.
    pub fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }

    fn pick<'a, T>(&mut self, from: &'a [T]) -> &'a T {
        &from[self.below(from.len())]
    }
}

/// Numbers at which arithmetic breaks, and words that files have meanings for.
const HARD: &[&str] = &[
    "0",
    "-0.0",
    "1e308",
    "-1e308",
    "1e-308",
    "5e-324",
    "1.7976931348623157e308",
    "1e400",
    "nan",
    "inf",
    "-inf",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
    "0x7f",
    "1_000",
    "1e",
    "+",
    "-",
    ".",
    "[]",
    "[[]]",
    "{}",
    "\"\"",
    "\"",
    "'''",
    "true",
    "null",
    "#",
    "\u{feff}",
    "\u{0}",
    "\r",
    "\n",
    "\t",
    ",",
    ";",
    ";;",
    "[[",
    "]]",
    "=",
    "[",
    "]",
    "é",
    "°",
    "𝑥",
    "a.b",
    "format = 1\n",
    "range = [1.0, 1.0]\n",
    "powers = [255]",
    "powers = [4294967295]",
    "order = 99",
    "max_order = 1000000",
    "N*m",
    "rad/s",
    "m^99",
    "1/0",
    "K^-1",
    "degC",
];

/// One changed text.
pub fn changed(texts: &[String], random: &mut Random) -> String {
    let mut bytes = random.pick(texts).clone().into_bytes();
    for _ in 0..=random.below(4) {
        change(&mut bytes, texts, random);
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn change(bytes: &mut Vec<u8>, texts: &[String], random: &mut Random) {
    let span = |length: usize, most: usize, random: &mut Random| {
        let from = random.below(length + 1);
        from..(from + random.below(most)).min(length)
    };
    let length = bytes.len();
    match random.below(9) {
        // A part is lost, comes twice, comes from another file, or everything after a place is lost.
        0 => drop(bytes.drain(span(length, 40, random))),
        1 => {
            let part = bytes[span(length, 200, random)].to_vec();
            let at = random.below(length + 1);
            bytes.splice(at..at, part);
        }
        2 => {
            let other = random.pick(texts).as_bytes();
            let part = other[span(other.len(), 300, random)].to_vec();
            let at = random.below(length + 1);
            bytes.splice(at..at, part);
        }
        3 => bytes.truncate(random.below(length + 1)),
        4 if length > 0 => {
            let at = random.below(length);
            bytes[at] ^= 1 << random.below(8);
        }
        // A line is lost, or changes its place.
        5 | 6 => {
            let mut lines: Vec<Vec<u8>> = bytes.split(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
            let line = lines.remove(random.below(lines.len()));
            if random.below(2) == 0 {
                let at = random.below(lines.len() + 1);
                lines.insert(at, line);
            }
            *bytes = lines.join(&b'\n');
        }
        7 => {
            let at = random.below(length + 1);
            bytes.splice(at..at, random.pick(HARD).bytes());
        }
        // A number becomes another.
        _ => {
            let is_part = |byte: &u8| byte.is_ascii_digit() || b"+-.e".contains(byte);
            let starts: Vec<usize> =
                (0..length).filter(|at| bytes[*at].is_ascii_digit() && (*at == 0 || !is_part(&bytes[at - 1]))).collect();
            if !starts.is_empty() {
                let from = *random.pick(&starts);
                let to = from + bytes[from..].iter().take_while(|byte| is_part(byte)).count();
                bytes.splice(from..to, random.pick(HARD).bytes());
            }
        }
    }
}
