//! MDF files of version 4: each channel group is a table with its own instants.
//!
//! Source: ASAM, "MDF (Measurement Data Format)", version 4.1: blocks `HD`, `DG`, `CG`, `CN`, `CC`, `DT`, `DZ`, `DL`, `HL`. A list of records is of
//! one group or of several. Numbers are whole or real, in both orders of bytes, at any bit. Conversions are computed, and marks of invalid numbers
//! make missing samples. A note lists what is not read: texts, arrays, formulas, groups without a time. No input makes this reader panic or read
//! past the end.

mod blocks;
mod channel;
mod conversion;

use std::collections::HashMap;

use rsm_core::source::{Fault, Faults};

use crate::log::{Log, Raw};
use blocks::{Block, Blocks, LARGEST, Read};
use channel::{Channel, channels};
use conversion::Conversion;

/// The address of the first block.
const HEAD: u64 = 64;

/// A clock needs three instants.
const FEWEST: usize = 3;

/// The limit of the numbers of a file: 2 GB.
const MOST_NUMBERS: usize = 250_000_000;

/// The first bytes of a file, also of one whose recording did not end.
pub(crate) fn is_mdf(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MDF     ") || bytes.starts_with(b"UnFinMF ")
}

/// The groups of channels that have a time, each with the instants as its column `time`. Only the wanted channels are read, if there is one of them.
pub(crate) fn read(file: &str, bytes: &[u8], wanted: &dyn Fn(&str) -> bool) -> Result<Vec<Log>, Faults> {
    let fault = |what: String| Fault::whole_file(file, what);
    let version = String::from_utf8_lossy(bytes.get(8..16).unwrap_or_default()).trim_matches(['\0', ' ']).to_string();
    if bytes.starts_with(b"UnFinMF ") {
        let help = "open it with the tool that recorded it and save it";
        return Err(Faults::one(fault("found an MDF file whose recording did not end".to_string()).help(help)));
    }
    if !version.starts_with('4') {
        let what = format!("found an MDF file of version `{version}`, expected version 4");
        return Err(Faults::one(fault(what).help("save it as MDF 4, or export it as CSV")));
    }
    groups(file, bytes, (&version, wanted)).map_err(|what| Faults::one(fault(format!("cannot be read as an MDF file: {what}"))))
}

fn groups(file: &str, bytes: &[u8], (version, wanted): (&str, &dyn Fn(&str) -> bool)) -> Read<Vec<Log>> {
    let blocks = Blocks(bytes);
    let head = blocks.one_of(HEAD, &["HD"])?;
    let mut notes = vec![format!("MDF file, version {version}")];
    let mut all: Vec<(Block, Vec<Group>)> = Vec::new();
    for data in blocks.chain(head.link(0), "DG")? {
        let groups = blocks.chain(data.link(1), "CG")?;
        let groups = groups.iter().map(|block| Group::read(&blocks, block, &mut notes)).collect::<Read<_>>()?;
        all.push((data, groups));
    }
    let mut channels = all.iter().flat_map(|it| &it.1).flat_map(|group| &group.channels).filter(|channel| !channel.is_time);
    let mut unread = Vec::new();
    if channels.any(|channel| wanted(&channel.name)) {
        for group in all.iter_mut().flat_map(|it| &mut it.1) {
            group.keep(wanted, &mut unread);
        }
    }
    let mut logs = Vec::new();
    let mut numbers = 0;
    let mut left = LARGEST;
    for (data, groups) in &all {
        let has_time = |group: &Group| group.channels.iter().any(|channel| channel.is_time);
        for group in groups.iter().filter(|group| !has_time(group) && !group.channels.is_empty()) {
            notes.push(format!("{} has no time and is not read", group.title()));
        }
        if !groups.iter().any(has_time) {
            continue;
        }
        let records = blocks.records(data.link(2), &mut left)?;
        let begins = begins(groups, &records, usize::from(data.u8(0)?))?;
        for (group, begins) in groups.iter().zip(begins).filter(|it| has_time(it.0)) {
            if begins.len() < FEWEST {
                notes.push(format!("{} has {} records and is not read", group.title(), begins.len()));
                continue;
            }
            if (begins.len() as u64) < group.records {
                notes.push(format!("{} has {} of its {} records", group.title(), begins.len(), group.records));
            }
            numbers += begins.len() * group.channels.len();
            if numbers > MOST_NUMBERS {
                return Err(format!(
                    "it has more than {MOST_NUMBERS} numbers, which is the limit: choose columns with --column"
                ));
            }
            let columns = group.columns(&records, &begins);
            let (file, lines, notes) = (file.to_string(), Vec::new(), Vec::new());
            logs.push(Log { file, columns, lines, notes, unread: Vec::new() });
        }
    }
    let Some(first) = logs.first_mut() else {
        notes.remove(0);
        return Err(format!("it has no channel group with a time and {FEWEST} records; {}", notes.join("; ")));
    };
    (first.notes, first.unread) = (notes, unread);
    Ok(logs)
}

/// A channel group.
struct Group {
    id: u64,
    records: u64,
    /// The length of a record: numbers, then marks of invalid numbers.
    numbers: usize,
    length: usize,
    /// Whether its records begin with their length: texts and bytes.
    is_variable: bool,
    name: String,
    channels: Vec<Channel>,
}

impl Group {
    fn read(blocks: &Blocks<'_>, block: &Block<'_>, notes: &mut Vec<String>) -> Read<Group> {
        let flags = block.u16(16)?;
        let (numbers, marks) = (block.u32(24)? as usize, block.u32(28)? as usize);
        let is_variable = flags & 1 != 0;
        let mut all = Vec::new();
        if !is_variable {
            channels(blocks, block.link(1), ("", 0), &mut all, notes)?;
            all.retain(|channel| {
                let is_inside = channel.is_inside(numbers);
                let why = match channel.conversion {
                    Conversion::Unknown => "has a formula as its conversion",
                    _ if !is_inside => "is outside of its records",
                    Conversion::Texts => {
                        notes.push(format!("`{}` has texts for its numbers: it is read as numbers", channel.name));
                        return true;
                    }
                    _ => return true,
                };
                notes.push(format!("`{}` {why} and is not read", channel.name));
                false
            });
        }
        Ok(Group {
            id: block.u64(0)?,
            records: block.u64(8)?,
            numbers,
            length: numbers.saturating_add(marks),
            is_variable,
            name: blocks.text(block.link(2))?,
            channels: all,
        })
    }

    /// Keeps the wanted channels and their time.
    fn keep(&mut self, wanted: &dyn Fn(&str) -> bool, unread: &mut Vec<String>) {
        let is_wanted = |channel: &Channel| !channel.is_time && wanted(&channel.name);
        let has_wanted = self.channels.iter().any(is_wanted);
        self.channels.retain(|channel| {
            let is_kept = is_wanted(channel) || channel.is_time && has_wanted;
            if !is_kept && !channel.is_time {
                unread.push(channel.name.clone());
            }
            is_kept
        });
    }

    fn title(&self) -> String {
        let first = self.channels.first().map_or("", |channel| channel.name.as_str());
        if self.name.is_empty() { format!("the group of `{first}`") } else { format!("the group `{}`", self.name) }
    }

    /// The columns of the channels, the time first.
    fn columns(&self, records: &[u8], begins: &[usize]) -> Vec<Raw> {
        let column = |channel: &Channel| {
            let number = |(index, begin): (usize, &usize)| {
                let value = channel.number(&records[*begin..*begin + self.length], self.numbers, index);
                // A number that is not finite is a missing sample.
                if value.is_finite() { value } else { f64::NAN }
            };
            let name = if channel.is_time { "time".to_string() } else { channel.name.clone() };
            let values = begins.iter().enumerate().map(number).collect();
            Raw { name, unit: channel.unit.clone(), values, texts: Vec::new() }
        };
        let (times, others): (Vec<&Channel>, Vec<&Channel>) = self.channels.iter().partition(|channel| channel.is_time);
        times.into_iter().chain(others).map(column).collect()
    }
}

/// For each group, where its records begin.
fn begins(groups: &[Group], records: &[u8], id_bytes: usize) -> Read<Vec<Vec<usize>>> {
    if id_bytes == 0 {
        // One group: its records are one behind the other.
        let [group] = groups else { return Err("records of several groups have no number of their group".to_string()) };
        let most = usize::try_from(group.records).unwrap_or(usize::MAX);
        let count = records.len().checked_div(group.length).unwrap_or(0).min(most);
        return Ok(vec![(0..count).map(|k| k * group.length).collect()]);
    }
    if !matches!(id_bytes, 1 | 2 | 4 | 8) {
        return Err(format!("found {id_bytes} bytes for the number of a group, expected 0, 1, 2, 4 or 8"));
    }
    let places: HashMap<u64, usize> = groups.iter().enumerate().map(|(k, group)| (group.id, k)).collect();
    let mut begins = vec![Vec::new(); groups.len()];
    let mut at = 0;
    let number = |at: usize, bytes: usize| -> Option<u64> {
        Some(records.get(at..at + bytes)?.iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte)))
    };
    while let Some(id) = number(at, id_bytes) {
        let Some(place) = places.get(&id) else { return Err(format!("a record is of the group {id}, which is not there")) };
        at += id_bytes;
        let group = &groups[*place];
        let length = if group.is_variable {
            let Some(length) = number(at, 4) else { break };
            at += 4;
            length as usize
        } else {
            group.length
        };
        // The last record may be cut off.
        let Some(end) = at.checked_add(length).filter(|end| *end <= records.len()) else { break };
        begins[*place].push(at);
        at = end;
    }
    Ok(begins)
}
