//! MDF files that asammdf 8.8 wrote (version 4.10: as they are, compressed, and compressed by columns), and files that this test writes byte by byte.
//!
//! Those of asammdf have two groups. `fast`: 40 rows, t = k/100 s, x = sin(7t) and u = 3 cos(5t) rounded to six decimals (u in single precision),
//! speed = 0.125 - 2 n of a stored number n = 8 (200 + k), count = k, invalid where k ends with 3. `slow`: 4 rows, each 0.13 s.

use rsm_import::{File, Record, Wishes, import};

use super::{assert_damage_is_a_fault, assert_notes, column, file, rounded};

fn wishes(columns: &[&str]) -> Wishes {
    Wishes { columns: columns.iter().map(|it| it.parse().unwrap()).collect(), ..Wishes::default() }
}

fn read(file: File, columns: &[&str]) -> Record {
    import(&[file], &wishes(columns)).unwrap_or_else(|faults| panic!("{faults}"))
}

const WRITTEN: [&str; 3] = ["plain.mf4", "deflate.mf4", "transposed.mf4"];

#[test]
fn numbers_units_and_conversions_of_a_group() {
    let time: Vec<f64> = (0..40).map(|k| f64::from(k) * 0.01).collect();
    let of = |formula: &dyn Fn(f64) -> f64| time.iter().map(|t| formula(*t)).collect::<Vec<f64>>();
    for name in WRITTEN {
        let record = read(file(name), &["x=x", "u=u", "speed=speed"]);
        assert_eq!(record.time, time, "{name}");
        assert!(!record.is_resampled, "{name}");
        assert_eq!(column(&record, "x"), of(&|t| rounded((7.0 * t).sin())), "{name}");
        assert_eq!(column(&record, "u"), of(&|t| f64::from(rounded(3.0 * (5.0 * t).cos()) as f32)), "{name}");
        let speed: Vec<f64> = (0..40).map(|k| -2.0 + 0.125 * f64::from(8 * (200 + k))).collect();
        assert_eq!(column(&record, "speed"), speed, "{name}");
        assert_eq!(
            record.columns.iter().filter_map(|it| it.unit.as_deref()).collect::<Vec<_>>(),
            ["V", "A", "1/min"],
            "{name}"
        );
    }
}

#[test]
fn an_invalid_number_is_a_missing_sample() {
    let record = read(file("plain.mf4"), &["count=count"]);
    // The missing ones are on the straight line between their neighbours, which has the same numbers here.
    assert!(record.is_resampled);
    assert_eq!(column(&record, "count"), (0..40).map(f64::from).collect::<Vec<_>>());
}

#[test]
fn rasters_are_brought_to_the_instants_of_the_fastest() {
    for name in WRITTEN {
        let record = read(file(name), &[]);
        // The slow group ends at 0.39 s.
        assert_eq!(record.rows(), 40, "{name}");
        let oil = column(&record, "oil");
        assert_eq!((oil[0], oil[13], oil[26], oil[39]), (20.0, 20.5, 21.5, 21.0), "{name}");
        assert!((oil[20] - (20.5 + 7.0 / 13.0)).abs() < 1e-12, "{name}: {}", oil[20]);
        // Whole numbers in steps hold their value.
        assert_eq!(column(&record, "state")[..14], [[0.0; 13].as_slice(), &[1.0]].concat(), "{name}");
        assert_notes(
            &record,
            &[
                "MDF file, version 4.10",
                "`mode` is no number",
                "`state` has texts for its numbers",
                "2 tables of one clock; the instants are those of the table of `x`",
                "`oil` is sampled every 0.13 s only",
            ],
        );
    }
    // A name that is not there: all names are listed, also of channels that nobody wished.
    let none = import(&[file("plain.mf4")], &wishes(&["oil=oil", "load=load"])).unwrap_err().to_string();
    assert!(none.contains("there is no column `load`") && none.contains("`speed`") && none.contains("`level`"), "{none}");
    // Of the wished columns the fastest gives the instants.
    let record = read(file("plain.mf4"), &["oil=oil", "level=level"]);
    assert_eq!((record.rows(), record.is_resampled), (4, false));
    assert_eq!(column(&record, "level"), [2.0, 6.0, 10.0, 102.0]);
}

/// A file that is written block by block: a block comes after those to which it links.
struct Written(Vec<u8>);

impl Written {
    fn new() -> Self {
        let mut bytes = b"MDF     4.10    by hand ".to_vec();
        bytes.resize(64, 0);
        let mut it = Written(bytes);
        it.block("HD", &[0; 6], &[0; 32]);
        it
    }

    fn block(&mut self, id: &str, links: &[u64], data: &[u8]) -> u64 {
        let at = self.0.len() as u64;
        self.0.extend(format!("##{id}\0\0\0\0").into_bytes());
        self.0.extend((24 + 8 * links.len() as u64 + data.len() as u64).to_le_bytes());
        self.0.extend((links.len() as u64).to_le_bytes());
        links.iter().for_each(|link| self.0.extend(link.to_le_bytes()));
        self.0.extend(data);
        self.0.resize(self.0.len().next_multiple_of(8), 0);
        at
    }

    fn text(&mut self, text: &str) -> u64 {
        self.block("TX", &[], format!("{text}\0").as_bytes())
    }

    fn conversion(&mut self, kind: u8, references: &[u64], values: &[f64]) -> u64 {
        let mut data = vec![kind, 0, 0, 0];
        data.extend((references.len() as u16).to_le_bytes());
        data.extend((values.len() as u16).to_le_bytes());
        data.extend([0; 16]);
        values.iter().for_each(|value| data.extend(value.to_le_bytes()));
        self.block("CC", &[&[0; 4], references].concat(), &data)
    }

    /// A channel. `kind`: its type, its kind of master, its type of data. `place`: first byte, first bit, number of bits.
    fn channel(&mut self, next: u64, name: &str, kind: [u8; 3], place: (u32, u8, u32), more: (u64, u64)) -> u64 {
        let name = self.text(name);
        let unit = self.block("MD", &[], b"<CNunit><TX>V</TX></CNunit>\0");
        let ((byte, bit, bits), (composition, conversion)) = (place, more);
        let mut data = kind.to_vec();
        data.push(bit);
        data.extend(byte.to_le_bytes());
        data.extend(bits.to_le_bytes());
        data.resize(72, 0);
        let unit = if kind[1] == 0 { unit } else { 0 };
        self.block("CN", &[next, composition, name, 0, conversion, 0, unit, 0], &data)
    }

    fn group(&mut self, next: u64, channels: u64, (id, records, flags, bytes): (u64, u64, u16, u32)) -> u64 {
        let mut data = [id.to_le_bytes(), records.to_le_bytes()].concat();
        data.extend(flags.to_le_bytes());
        data.extend([0; 6]);
        data.extend(bytes.to_le_bytes());
        data.extend([0; 4]);
        self.block("CG", &[next, channels, 0, 0, 0, 0], &data)
    }

    fn data_group(&mut self, next: u64, groups: u64, records: u64, id_bytes: u8) -> u64 {
        self.block("DG", &[next, groups, records, 0], &[id_bytes, 0, 0, 0, 0, 0, 0, 0])
    }

    fn finish(mut self, first: u64) -> File {
        self.0[88..96].copy_from_slice(&first.to_le_bytes());
        File { name: "by_hand.mf4".to_string(), bytes: self.0 }
    }
}

/// Three groups in one list of records, which is in two parts: one with bits across bytes, one with a conversion by ranges, one with texts.
fn mixed() -> File {
    let mut it = Written::new();
    let milliseconds = it.conversion(1, &[], &[0.0, 0.001]);
    let half = it.conversion(1, &[], &[1.0, 0.5]);
    let text = it.text("not available");
    // Up to 99 a line, 200 and 201 are texts, all others are halved.
    let line = it.conversion(2, &[], &[0.0, 2.0, 4.0, 0.0, 0.0, 2.0]);
    let ranges = it.conversion(8, &[line, text, half], &[0.0, 100.0, 200.0, 201.0]);
    let texts = it.channel(0, "remark", [1, 0, 7], (0, 0, 0), (0, 0));
    let variable = it.group(0, texts, (11, 6, 1, 0));
    let level = it.channel(0, "level", [0, 0, 0], (4, 0, 8), (0, ranges));
    let time = it.channel(level, "clock", [2, 1, 0], (0, 0, 32), (0, milliseconds));
    let slow = it.group(variable, time, (9, 6, 0, 5));
    let inside = it.channel(0, "b", [0, 0, 2], (9, 0, 4), (0, 0));
    let inside = it.channel(inside, "a", [0, 0, 1], (8, 4, 12), (0, 0));
    let structure = it.channel(0, "bus", [0, 0, 10], (8, 0, 16), (inside, 0));
    let time = it.channel(structure, "t", [2, 1, 5], (0, 0, 64), (0, 0));
    let fast = it.group(slow, time, (7, 12, 0, 10));
    let mut records = Vec::new();
    for k in 0..12_u16 {
        records.push(7);
        records.extend((f64::from(k) * 0.5).to_be_bytes());
        // Twelve bits in the order of Motorola, then four bits with a sign in the same byte.
        records.extend(((300 + k) << 4 | (k & 15)).to_be_bytes());
        if k % 2 == 0 {
            records.extend([9]);
            records.extend((u32::from(k) * 500).to_le_bytes());
            records.push([10, 99, 200, 201, 220, 40][usize::from(k / 2)]);
            records.extend([11, 3, 0, 0, 0, b'a', b'b', 0]);
        }
    }
    let (one, other) = records.split_at(77);
    let (one, other) = (it.block("DT", &[], one), it.block("DT", &[], other));
    let list = it.block("DL", &[0, one, other], &[0; 24]);
    let list = it.block("HL", &[list], &[0; 8]);
    let group = it.data_group(0, fast, list, 1);
    it.finish(group)
}

#[test]
fn records_of_several_groups_in_one_list() {
    let record = read(mixed(), &["a=bus.a", "b=bus.b"]);
    assert_eq!(record.time, (0..12).map(|k| f64::from(k) * 0.5).collect::<Vec<_>>());
    assert_eq!(column(&record, "a"), (0..12).map(|k| f64::from(300 + k)).collect::<Vec<_>>());
    // From 8 on the four bits are negative.
    assert_eq!(column(&record, "b"), (0..12).map(|k| f64::from(if k < 8 { k } else { k - 16 })).collect::<Vec<_>>());
    assert_eq!(record.columns[0].unit.as_deref(), Some("V"));
    // 10: (2*10 + 4)/2; 99: (2*99 + 4)/2; 200 and 201 are texts; 220: 1 + 220/2; 40: (2*40 + 4)/2. Where there are texts, the
    // number before is held.
    let level = read(mixed(), &["level=level"]);
    assert_eq!(column(&level, "level"), [12.0, 101.0, 101.0, 101.0, 111.0, 42.0]);
    assert_eq!(level.time, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
}

/// Names are wished as the record has them: signs that a header cannot have are replaced, and of two columns with one name the later one has a
/// number.
#[test]
fn channels_are_wished_by_the_names_of_their_columns() {
    let mut it = Written::new();
    let next = it.channel(0, "x[0]", [0, 0, 0], (1, 0, 8), (0, 0));
    let next = it.channel(next, "x[0]", [0, 0, 0], (2, 0, 8), (0, 0));
    let next = it.channel(next, "other", [0, 0, 0], (2, 0, 8), (0, 0));
    let time = it.channel(next, "t", [2, 1, 0], (0, 0, 8), (0, 0));
    let group = it.group(0, time, (0, 4, 0, 3));
    let records = it.block("DT", &[], &[0, 5, 9, 1, 6, 8, 2, 7, 7, 3, 8, 5]);
    let group = it.data_group(0, group, records, 0);
    let record = read(it.finish(group), &["a=x_0_", "b=x_0__2"]);
    assert_eq!((column(&record, "a"), column(&record, "b")), (&[9.0, 8.0, 7.0, 5.0][..], &[5.0, 6.0, 7.0, 8.0][..]));
}

#[test]
fn tables_virtual_times_and_what_is_not_read() {
    let mut it = Written::new();
    let period = it.conversion(1, &[], &[10.0, 0.25]);
    let line = it.conversion(4, &[], &[0.0, 0.0, 10.0, 100.0, 20.0, 0.0]);
    let nearest = it.conversion(5, &[], &[0.0, -1.0, 10.0, 5.0]);
    let steps = it.conversion(6, &[], &[0.0, 5.0, 7.0, 5.0, 9.0, 8.0, 3.0]);
    let formula = it.conversion(3, &[], &[]);
    let array = it.block("CA", &[0], &[0; 16]);
    let next = it.channel(0, "by_formula", [0, 0, 0], (0, 0, 8), (0, formula));
    let next = it.channel(next, "array", [0, 0, 0], (0, 0, 8), (array, 0));
    let next = it.channel(next, "outside", [0, 0, 0], (1, 0, 16), (0, 0));
    let next = it.channel(next, "steps", [0, 0, 0], (0, 0, 8), (0, steps));
    let next = it.channel(next, "nearest", [0, 0, 0], (0, 0, 8), (0, nearest));
    let next = it.channel(next, "line", [0, 0, 0], (0, 0, 8), (0, line));
    let time = it.channel(next, "", [3, 1, 0], (0, 0, 0), (0, period));
    let group = it.group(0, time, (0, 9, 0, 1));
    // The recording says nine records, and has seven.
    let records = it.block("DT", &[], &[0, 4, 5, 6, 9, 15, 30]);
    let angles = it.channel(0, "angle", [2, 2, 0], (0, 0, 8), (0, 0));
    let no_time = it.group(0, angles, (0, 7, 0, 1));
    let no_time = it.data_group(0, no_time, records, 0);
    let group = it.data_group(no_time, group, records, 0);
    let record = read(it.finish(group), &[]);
    assert_eq!(record.time, (0..7).map(|k| 10.0 + 0.25 * f64::from(k)).collect::<Vec<_>>());
    assert_eq!(column(&record, "line"), [0.0, 40.0, 50.0, 60.0, 90.0, 50.0, 0.0]);
    assert_eq!(column(&record, "nearest"), [-1.0, -1.0, -1.0, 5.0, 5.0, 5.0, 5.0]);
    assert_eq!(column(&record, "steps"), [7.0, 7.0, 8.0, 8.0, 8.0, 3.0, 3.0]);
    assert_eq!(record.columns.len(), 3);
    assert_notes(
        &record,
        &[
            "`by_formula` has a formula",
            "`array` is an array",
            "`outside` is outside of its records",
            "the group of `angle` has no time",
            "has 7 of its 9 records",
        ],
    );
}

#[test]
fn what_cannot_be_read_is_named() {
    let fault = |file: File| import(&[file], &Wishes::default()).unwrap_err().to_string();
    let changed = |at: usize, by: &[u8]| {
        let mut file = mixed();
        file.bytes[at..at + by.len()].copy_from_slice(by);
        file
    };
    assert!(fault(changed(0, b"UnFinMF ")).contains("recording did not end"));
    assert!(fault(changed(8, b"3.30")).contains("version `3.30`, expected version 4"));
    let ring = {
        let mut file = mixed();
        let first = u64::from_le_bytes(file.bytes[88..96].try_into().unwrap()) as usize;
        file.bytes.copy_within(88..96, first + 24);
        file
    };
    assert!(fault(ring).contains("have no end"));
    let endless = {
        let mut file = mixed();
        let channels: Vec<usize> = (0..file.bytes.len() - 4).filter(|at| &file.bytes[*at..*at + 4] == b"##CN").collect();
        // Both members of the structure become structures with these two members.
        let [second, first] = [channels[3], channels[4]];
        for member in [first, second] {
            file.bytes[member + 32..member + 40].copy_from_slice(&(first as u64).to_le_bytes());
        }
        file
    };
    assert!(fault(endless).contains("structures of channels have no end"));
    let place = |file: &File, id: &[u8]| file.bytes.windows(4).position(|part| part == id).unwrap();
    let by_columns = changed(place(&mixed(), b"##HL"), b"##LD");
    assert!(fault(by_columns).contains("stored by columns (MDF 4.2)"));
    let compressed = file("deflate.mf4");
    let at = place(&compressed, b"##DZ");
    let with = |offset: usize, byte: u8| {
        let mut file = file("deflate.mf4");
        file.bytes[at + 24 + offset] = byte;
        fault(file)
    };
    assert!(with(2, 7).contains("found the compression 7"), "{}", with(2, 7));
    assert!(with(14, 1).contains("more than 2000000000 bytes"), "{}", with(14, 1));
    assert!(with(8, 1).contains("is damaged"), "{}", with(8, 1));
}

/// Every file cut off at 150 places, and each of its bytes changed.
#[test]
fn damaged_files_are_faults() {
    for whole in WRITTEN.map(file).into_iter().chain([mixed()]) {
        assert_damage_is_a_fault(&whole, 1);
    }
}
