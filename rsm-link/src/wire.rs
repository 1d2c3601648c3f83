//! The datagram format: number, time stamp, hash of the model, values, and a keyed message authentication code.
//!
//! In: a [`Datagram`] and a [`Key`]. Out: bytes; and the reverse. A datagram is [`Rejected`] and discarded if it was changed, or if it comes from a
//! sender without the key, from another model or from the wrong side. All numbers are little-endian; a value keeps its bits, also NaN.
//!
//! ```text
//!   0   "RSM" 1      4   kind, side, count of values, 0    8   hash of the model (16)
//!   24  session      32  session of the peer               40  number      48  time, ns
//!   56  time of the datagram heard last, ns                64  how long ago that was, ns
//!   72  values (8 each)                                    then HMAC-SHA-256 of all before, its first 16 bytes
//! ```
//!
//! A session is a random number of each run. A datagram is valid only if it contains the session of its receiver, so recorded datagrams of an older
//! run are rejected.

use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::{Digest as _, Sha256};

use crate::loops::{Loop, WIDEST};

const MAGIC: [u8; 4] = *b"RSM\x01";
const HEAD: usize = 72;
const TAG: usize = 16;

/// The longest datagram, in bytes.
pub const LONGEST: usize = HEAD + 8 * WIDEST + TAG;

/// A shorter secret is refused.
pub const SHORTEST_KEY: usize = 16;

/// The secret that both sides have.
#[derive(Clone)]
pub struct Key(Hmac<Sha256>);

impl std::fmt::Debug for Key {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Key")
    }
}

impl Key {
    /// Makes a key from the bytes of a secret; a line end after them is not part of the secret.
    ///
    /// # Errors
    /// Fewer than [`SHORTEST_KEY`] bytes.
    pub fn new(secret: &[u8]) -> Result<Self, String> {
        let secret = secret.strip_suffix(b"\n").unwrap_or(secret);
        let secret = secret.strip_suffix(b"\r").unwrap_or(secret);
        if secret.len() < SHORTEST_KEY {
            return Err(format!("the key has {} bytes, expected {SHORTEST_KEY} at least", secret.len()));
        }
        // HMAC accepts keys of any length.
        Hmac::new_from_slice(secret).map(Key).map_err(|error| error.to_string())
    }
}

/// The hash of all data that must be equal on both sides: coefficients and plant of a loop, and names and units of the exchanged values.
#[must_use]
pub fn model_hash(control_loop: Loop) -> [u8; 16] {
    let files: [&[u8]; 3] = match control_loop {
        Loop::Motor => [
            include_bytes!("../../generated/coefficients/motor.toml"),
            include_bytes!("../../generated/coefficients/circle.toml"),
            include_bytes!("../../rsm-sim/plants/pmac.toml"),
        ],
        Loop::Throttle => [
            include_bytes!("../../generated/coefficients/driveline.toml"),
            include_bytes!("../../generated/coefficients/throttle.toml"),
            include_bytes!("../../rsm-sim/plants/driveline.toml"),
        ],
    };
    let mut hash = Sha256::new();
    for file in files {
        hash.update((file.len() as u64).to_le_bytes());
        hash.update(file);
    }
    for signal in control_loop.sample().iter().chain(control_loop.command()) {
        hash.update(format!("{}[{}];", signal.name, signal.unit));
    }
    let hash = hash.finalize();
    std::array::from_fn(|k| hash[k])
}

/// The kind of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A hello; it has no values.
    Hello,
    /// A sample or a command.
    Data,
    /// The run of the sender is over; it has no values.
    End,
}

/// The side of a loop that sent a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The plant's side.
    Plant,
    /// The step's side.
    Step,
}

/// A datagram.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Datagram {
    /// Its kind.
    pub kind: Kind,
    /// The side that sends it.
    pub side: Side,
    /// The session of the sender.
    pub session: u64,
    /// The session of the peer as the sender has received it; 0 before that.
    pub peer_session: u64,
    /// The number of the tick.
    pub number: u64,
    /// The sender's time, in ns after its start.
    pub time_ns: u64,
    /// The time in the last datagram that the sender has received; 0 before that.
    pub echo_ns: u64,
    /// The time since that datagram was received, in ns.
    pub echo_age_ns: u64,
    /// Number of values.
    pub count: usize,
    /// The values, then zeros.
    pub values: [f64; WIDEST],
}

/// Why a datagram is rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rejected {
    /// It has another format, or its authentication code is wrong.
    Unsigned,
    /// It was made with the key, but has another version or comes from the wrong side.
    Misplaced,
    /// It was made with the key, but for another model.
    OtherModel,
}

impl Datagram {
    /// The bytes, and their number.
    #[must_use]
    pub fn write(&self, model: &[u8; 16], key: &Key) -> ([u8; LONGEST], usize) {
        let mut bytes = [0; LONGEST];
        let count = self.count.min(WIDEST);
        bytes[..4].copy_from_slice(&MAGIC);
        bytes[4] = match self.kind {
            Kind::Hello => 0,
            Kind::Data => 1,
            Kind::End => 2,
        };
        bytes[5] = u8::from(self.side == Side::Step);
        bytes[6] = count as u8;
        bytes[8..24].copy_from_slice(model);
        let words = [self.session, self.peer_session, self.number, self.time_ns, self.echo_ns, self.echo_age_ns];
        let values = self.values[..count].iter().map(|value| value.to_bits());
        for (place, word) in bytes[24..].chunks_exact_mut(8).zip(words.into_iter().chain(values)) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        let end = HEAD + 8 * count;
        let code = key.0.clone().chain_update(&bytes[..end]).finalize().into_bytes();
        bytes[end..end + TAG].copy_from_slice(&code[..TAG]);
        (bytes, end + TAG)
    }

    /// Reads the bytes of a datagram from the side `from`.
    ///
    /// # Errors
    /// The bytes are not a valid datagram for this receiver.
    pub fn read(bytes: &[u8], from: Side, model: &[u8; 16], key: &Key) -> Result<Self, Rejected> {
        let Some(end) = bytes.len().checked_sub(TAG).filter(|end| (HEAD..=HEAD + 8 * WIDEST).contains(end)) else {
            return Err(Rejected::Unsigned);
        };
        // The comparison takes constant time, and comes before anything else is read.
        let code = key.0.clone().chain_update(&bytes[..end]);
        code.verify_truncated_left(&bytes[end..]).map_err(|_| Rejected::Unsigned)?;
        let side = if bytes[5] == 1 { Side::Step } else { Side::Plant };
        let kind = match bytes[4] {
            0 => Kind::Hello,
            1 => Kind::Data,
            2 => Kind::End,
            _ => return Err(Rejected::Misplaced),
        };
        let count = usize::from(bytes[6]);
        if bytes[..4] != MAGIC || side != from || end != HEAD + 8 * count {
            return Err(Rejected::Misplaced);
        }
        if bytes[8..24] != model[..] {
            return Err(Rejected::OtherModel);
        }
        let word = |place: usize| {
            let mut word = [0; 8];
            word.copy_from_slice(&bytes[place..place + 8]);
            u64::from_le_bytes(word)
        };
        let mut values = [0.0; WIDEST];
        for (k, value) in values[..count].iter_mut().enumerate() {
            *value = f64::from_bits(word(HEAD + 8 * k));
        }
        Ok(Datagram {
            kind,
            side,
            session: word(24),
            peer_session: word(32),
            number: word(40),
            time_ns: word(48),
            echo_ns: word(56),
            echo_age_ns: word(64),
            count,
            values,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(text: &str) -> Key {
        Key::new(text.as_bytes()).unwrap()
    }

    const MODEL: [u8; 16] = [7; 16];

    fn datagram() -> Datagram {
        Datagram {
            kind: Kind::Data,
            side: Side::Step,
            session: 1 << 63,
            peer_session: 2,
            number: 3,
            time_ns: 4,
            echo_ns: 5,
            echo_age_ns: u64::MAX,
            count: 2,
            values: [-0.0, 1e-310, 0.0, 0.0],
        }
    }

    #[test]
    fn what_is_written_is_read_with_the_same_bits() {
        let key = key("sixteen bytes ok");
        for count in 0..=WIDEST {
            let mut sent = Datagram { count, ..datagram() };
            for (k, value) in sent.values[..count].iter_mut().enumerate() {
                *value = [f64::NEG_INFINITY, 0.1, -0.0, 1e-310][k];
            }
            sent.values[count..].fill(0.0);
            let (bytes, length) = sent.write(&MODEL, &key);
            let read = Datagram::read(&bytes[..length], Side::Step, &MODEL, &key).unwrap();
            assert_eq!((read.values.map(f64::to_bits), read), (sent.values.map(f64::to_bits), sent));
        }
        let torn = Datagram { values: [f64::NAN, 0.0, 0.0, 0.0], count: 1, ..datagram() };
        let (bytes, length) = torn.write(&MODEL, &key);
        assert!(Datagram::read(&bytes[..length], Side::Step, &MODEL, &key).unwrap().values[0].is_nan());
    }

    #[test]
    fn every_changed_bit_and_every_other_length_is_foreign() {
        let key = key("sixteen bytes ok");
        let (bytes, length) = datagram().write(&MODEL, &key);
        let read = |bytes: &[u8]| Datagram::read(bytes, Side::Step, &MODEL, &key);
        for bit in 0..8 * length {
            let mut changed = bytes;
            changed[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(read(&changed[..length]), Err(Rejected::Unsigned), "bit {bit}");
        }
        for other in (0..=LONGEST).filter(|other| *other != length) {
            assert_eq!(read(&bytes[..other]), Err(Rejected::Unsigned), "{other} bytes");
        }
        assert_eq!(read(&[0; 2000]), Err(Rejected::Unsigned));
    }

    #[test]
    fn another_key_another_model_and_the_wrong_side_have_different_errors() {
        let key = key("sixteen bytes ok");
        let (bytes, length) = datagram().write(&MODEL, &key);
        let bytes = &bytes[..length];
        assert_eq!(Datagram::read(bytes, Side::Step, &MODEL, &self::key("sixteen bytes no")), Err(Rejected::Unsigned));
        assert_eq!(Datagram::read(bytes, Side::Step, &[8; 16], &key), Err(Rejected::OtherModel));
        // A datagram of this side is sent back to this side.
        assert_eq!(Datagram::read(bytes, Side::Plant, &MODEL, &key), Err(Rejected::Misplaced));
        assert_ne!(model_hash(Loop::Motor), model_hash(Loop::Throttle));
    }

    #[test]
    fn a_key_is_long_enough_and_has_no_line_end() {
        assert_eq!(Key::new(b"short\n").unwrap_err(), "the key has 5 bytes, expected 16 at least");
        let (one, _) = datagram().write(&MODEL, &key("sixteen bytes ok"));
        let (other, _) = datagram().write(&MODEL, &key("sixteen bytes ok\r\n"));
        assert_eq!(one, other);
        // RFC 4231, test case 4. It shows that the crate computes HMAC-SHA-256.
        let secret: Vec<u8> = (1..=25).collect();
        let code = Key::new(&secret).unwrap().0.chain_update([0xcd; 50]).finalize().into_bytes();
        assert_eq!(code[..4], [0x82, 0x55, 0x8a, 0x38]);
    }
}
