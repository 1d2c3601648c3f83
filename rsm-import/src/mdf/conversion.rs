//! Conversions from stored numbers to physical ones (block `CC`).
//!
//! In: a block. Out: a function of one number; NaN is no number. A conversion to texts gives the stored number, unless it also converts to numbers:
//! then its texts mean "no value", as in "sensor not available".

use super::blocks::{Blocks, Read};

/// The nesting limit of conversions inside of conversions.
const DEEPEST: usize = 4;

/// A conversion.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Conversion {
    Same,
    /// a + b x.
    Linear(f64, f64),
    /// (a x^2 + b x + c)/(d x^2 + e x + f).
    Rational([f64; 6]),
    /// Pairs of a stored and a physical number.
    Table {
        pairs: Vec<[f64; 2]>,
        interpolates: bool,
    },
    /// Ranges with their conversions, `None` for a text, and that of all other numbers.
    Ranges {
        list: Vec<([f64; 2], Option<Conversion>)>,
        other: Option<Box<Conversion>>,
    },
    /// Texts for numbers: the stored number is kept.
    Texts,
    /// A formula as a text, or a conversion of texts. It is not computed.
    Unknown,
}

impl Conversion {
    /// The conversion at an address; 0 is none.
    pub(super) fn read(blocks: &Blocks<'_>, at: u64, depth: usize) -> Read<Conversion> {
        if at == 0 {
            return Ok(Conversion::Same);
        }
        if depth > DEEPEST {
            return Err(format!("byte {at}: conversions are nested more than {DEEPEST} times"));
        }
        let block = blocks.one_of(at, &["CC"])?;
        let count = usize::from(block.u16(6)?);
        let value = |place: usize| block.f64(24 + 8 * place);
        let values = (0..count).map(value).collect::<Read<Vec<f64>>>()?;
        // References come after name, unit, comment and inverse.
        let inner = |place: usize| -> Read<Option<Conversion>> {
            let at = block.link(4 + place);
            let is_text = at == 0 || blocks.block(at)?.id != *b"CC";
            Ok(if is_text { None } else { Some(Conversion::read(blocks, at, depth + 1)?) })
        };
        let ranges = |list: Vec<[f64; 2]>| -> Read<Conversion> {
            let other = inner(list.len())?.map(Box::new);
            let list: Vec<_> = list.into_iter().enumerate().map(|(k, range)| Ok((range, inner(k)?))).collect::<Read<_>>()?;
            let has_numbers = other.is_some() || list.iter().any(|it| it.1.is_some());
            Ok(if has_numbers { Conversion::Ranges { list, other } } else { Conversion::Texts })
        };
        Ok(match (block.u8(0)?, values.as_slice()) {
            (0, _) => Conversion::Same,
            (1, [a, b, ..]) => Conversion::Linear(*a, *b),
            (2, [a, b, c, d, e, f, ..]) => Conversion::Rational([*a, *b, *c, *d, *e, *f]),
            (kind @ (4 | 5), values) if values.len() >= 2 => {
                let pairs = values.as_chunks::<2>().0.to_vec();
                Conversion::Table { pairs, interpolates: kind == 4 }
            }
            (6, values) => {
                let (list, rest) = values.as_chunks::<3>();
                let constant = |value: f64| Conversion::Linear(value, 0.0);
                let list = list.iter().map(|[low, high, value]| ([*low, *high], Some(constant(*value)))).collect();
                Conversion::Ranges { list, other: rest.first().map(|value| Box::new(constant(*value))) }
            }
            (7, values) => ranges(values.iter().map(|value| [*value; 2]).collect())?,
            (8, values) => ranges(values.as_chunks::<2>().0.to_vec())?,
            (11, _) => Conversion::Texts,
            _ => Conversion::Unknown,
        })
    }

    /// The physical number of a stored one.
    pub(super) fn apply(&self, x: f64) -> f64 {
        if x.is_nan() {
            return x;
        }
        match self {
            Conversion::Same | Conversion::Texts => x,
            Conversion::Linear(a, b) => a + b * x,
            Conversion::Rational([a, b, c, d, e, f]) => (a * x * x + b * x + c) / (d * x * x + e * x + f),
            Conversion::Table { pairs, interpolates } => {
                let after = pairs.partition_point(|pair| pair[0] <= x);
                match (after.checked_sub(1).map(|k| pairs[k]), pairs.get(after).copied()) {
                    (Some([_, y]), None) | (None, Some([_, y])) => y,
                    (Some([from, y]), Some([to, next])) if *interpolates => y + (next - y) * ((x - from) / (to - from)),
                    (Some([from, y]), Some([to, next])) => {
                        if x - from <= to - x {
                            y
                        } else {
                            next
                        }
                    }
                    (None, None) => f64::NAN,
                }
            }
            Conversion::Ranges { list, other } => {
                // The end of a range belongs to the next one, if there is one: whole numbers have distance between ranges.
                let found = list.iter().find(|([low, high], _)| (*low..*high).contains(&x) || low == high && *low == x);
                let found = found.or_else(|| list.iter().find(|([_, high], _)| *high == x));
                let conversion = found.map_or(other.as_deref(), |(_, inner)| inner.as_ref());
                conversion.map_or(f64::NAN, |inner| inner.apply(x))
            }
            Conversion::Unknown => f64::NAN,
        }
    }
}
