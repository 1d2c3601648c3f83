//! Fits of Parquet and Arrow files against fits of the same rows in CSV.

mod written;

use std::path::{Path, PathBuf};

use arrow_ipc::CompressionType;
use parquet::basic::{Compression, GzipLevel, ZstdLevel};
use parquet::file::properties::WriterVersion;
use rsm_core::source::Source;

use crate::content::Content;
use crate::fit::{Outcome, fit};
use crate::hash;
use crate::missing::MissingAs;
use crate::partial::{of_files, of_sources};
use crate::random::Random;
use crate::spec::Specification;
use crate::table::{Table, Wanted};
use written::{Arrow, Cells, Parquet, Text, Written, csv};

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("rsm-columnar-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn column(header: &'static str, cells: Cells, is_nullable: bool) -> Written {
    Written { header, cells, is_nullable }
}

fn all<T>(values: Vec<T>) -> Vec<Option<T>> {
    values.into_iter().map(Some).collect()
}

const PLAIN: Parquet = Parquet {
    rows_of_group: 1 << 20,
    rows_of_page: 1 << 20,
    compression: Compression::UNCOMPRESSED,
    has_dictionary: true,
    version: WriterVersion::PARQUET_1_0,
};

const FILE: Arrow = Arrow { rows_of_batch: 1 << 20, compression: None, is_stream: false };

fn any_parquet(random: &mut Random) -> Parquet {
    let (zstd, gzip) = (Compression::ZSTD(ZstdLevel::default()), Compression::GZIP(GzipLevel::default()));
    Parquet {
        rows_of_group: 1 + random.below(300) as usize,
        rows_of_page: 1 + random.below(100) as usize,
        compression: [Compression::UNCOMPRESSED, Compression::SNAPPY, zstd, gzip][random.below(4) as usize],
        has_dictionary: random.below(2) == 0,
        version: [WriterVersion::PARQUET_1_0, WriterVersion::PARQUET_2_0][random.below(2) as usize],
    }
}

fn any_arrow(random: &mut Random) -> Arrow {
    let compressions = [None, Some(CompressionType::LZ4_FRAME), Some(CompressionType::ZSTD)];
    Arrow {
        rows_of_batch: 1 + random.below(300) as usize,
        compression: compressions[random.below(3) as usize],
        is_stream: random.below(2) == 0,
    }
}

/// Rows of a test rig: numbers of several types, two columns that keep rows together, a weight, a run number, and a column that nothing uses.
fn any_rows(random: &mut Random, rows: usize, first_run: u32) -> Vec<Written> {
    let text = [Text::Small, Text::Large, Text::View, Text::Dictionary][random.below(4) as usize];
    let some = |random: &mut Random, share: f64| random.share() >= share;
    let a: Vec<f64> = (0..rows).map(|_| 9.0 * random.share()).collect();
    let k: Vec<u64> = (0..rows).map(|_| random.below(10)).collect();
    let y: Vec<f64> = a.iter().zip(&k).map(|(a, k)| 1.0 + a * *k as f64 - 0.2 * a * a + 0.1 * random.normal()).collect();
    let y = y.into_iter().map(|y| some(random, 0.03).then_some(y)).collect();
    // Blanks around a text do not count.
    let names = ["north", "south", " east", "west  ", "a, b", "NA"];
    let rig = (0..rows).map(|_| some(random, 0.02).then(|| names[random.below(6) as usize].to_string())).collect();
    let days: Vec<u64> = (0..rows).map(|row| row as u64 / 7 + random.below(2)).collect();
    let day = match random.below(4) {
        0 => Cells::I32(days.iter().map(|day| some(random, 0.02).then_some(*day as i32 - 3)).collect()),
        1 => Cells::F64(days.iter().map(|day| some(random, 0.02).then_some(*day as f64 / 3.0)).collect()),
        2 => Cells::Bool(days.iter().map(|day| some(random, 0.02).then_some(day % 3 == 0)).collect()),
        _ => Cells::U64(days.iter().map(|day| some(random, 0.02).then_some(u64::MAX - day)).collect()),
    };
    let mut runs: Vec<u32> = (first_run..first_run + rows as u32).collect();
    random.shuffle(&mut runs);
    let a = match random.below(2) {
        0 => Cells::F32(a.iter().map(|a| Some(*a as f32)).collect()),
        _ => Cells::F64(a.iter().map(|a| some(random, 0.02).then_some(*a)).collect()),
    };
    let k = match random.below(3) {
        0 => Cells::U64(all(k)),
        1 => Cells::I64(k.iter().map(|k| some(random, 0.02).then_some(*k as i64)).collect()),
        _ => Cells::F64(k.iter().map(|k| Some(*k as f64)).collect()),
    };
    let weights = (0..rows).map(|_| Some(0.5 + random.share())).collect();
    let has_all = |cells: &Cells| !csv(&[column("x", cells.clone(), true)]).contains("\n\n");
    let is_nullable = |cells: &Cells, random: &mut Random| !has_all(cells) || random.below(2) == 0;
    let columns = [
        ("a[m]", a),
        ("note", Cells::Text(vec![None; rows], text)),
        ("rig", Cells::Text(rig, text)),
        ("k [1]", k),
        ("day", day),
        ("Run", Cells::U32(all(runs))),
        ("w", Cells::F64(weights)),
        ("y[V]", Cells::F64(y)),
    ];
    columns.map(|(header, cells)| column(header, cells.clone(), is_nullable(&cells, random))).into()
}

/// A fit, and everything that it found but the names and hashes of its files.
fn found(specification: &Specification, folder: &Path) -> (Outcome, String) {
    let outcome = fit(specification, &mut |_| {}).unwrap();
    let mut found = format!("{outcome:?}").replace(&hash::hash(specification.source().unwrap().text()), "HASH");
    for file in &outcome.files {
        assert_eq!(file.sha256, hash::of_file(&folder.join(&file.name)).unwrap());
        found = found.replace(&file.name, "FILE").replace(&file.sha256, "HASH");
    }
    (outcome, found)
}

/// Files with any sizes of groups, pages and batches, any compression, and any of the types.
#[test]
fn a_fit_of_columns_is_the_fit_of_the_same_csv() {
    let folder = folder("fit");
    let (mut left_out, mut validated) = (0, 0);
    for seed in 0..16 {
        let random = &mut Random::new(seed);
        let text = |data: &str, apart: &str| {
            let together = if seed % 2 == 0 { "rig" } else { "day" };
            // Where the rig keeps no rows together it is an input.
            let levels = "[\"north\", \"south\", \"east\", \"west\", \"a, b\"]";
            let (category, of_category) = match seed % 4 {
                1 => (format!("[inputs.rig]\ncategories = {levels}\nadditive = true\n"), ", \"rig\""),
                3 => (format!("[inputs.rig]\ncategories = {levels}\n"), ", \"rig\""),
                _ => (String::new(), ""),
            };
            let validate = format!("{{ share = 0.3, seed = {seed}, keep_together = [\"{together}\"] }}");
            let text = format!(
                "format = 1\nmodel = \"m\"\ndata = [{data}]\nmissing = \"drop-row\"\nvalidate = {validate}\ntest = [\"{apart}\"]\n[inputs.a]\n\
                 unit = \"cm\"\n[inputs.k]\n{category}[responses.y]\nunit = \"mV\"\ninputs = [\"a\", \"k\"{of_category}]\nweights = \"w\"\n\
                 select = {{ method = \"ladder\", max_order = 3, confidence = 95.0 }}\n"
            );
            Specification::from_source(Source::new("fit.toml", text), folder.clone()).unwrap()
        };
        let tables: Vec<Vec<Written>> =
            [(400, 60), (60, 0), (90, 0)].into_iter().map(|(rows, run)| any_rows(random, rows, run)).collect();
        // A third of the files stays CSV.
        let name_of = |(k, table): (usize, &Vec<Written>)| {
            std::fs::write(folder.join(format!("rows-{k}.csv")), csv(table)).unwrap();
            let name = format!("file-{k}-{seed}");
            let path = folder.join(&name);
            match (seed as usize + k) % 3 {
                0 => any_parquet(random).write(&path, table),
                1 => any_arrow(random).write(&path, table),
                _ => std::fs::write(&path, csv(table)).unwrap(),
            }
            name
        };
        let names: Vec<String> = tables.iter().enumerate().map(name_of).collect();
        let (expected, of_csv) = found(&text("\"rows-0.csv\", \"rows-1.csv\"", "rows-2.csv"), &folder);
        let (_, read) = found(&text(&format!("\"{}\", \"{}\"", names[0], names[1]), &names[2]), &folder);
        let at = read.bytes().zip(of_csv.bytes()).position(|(a, b)| a != b).unwrap_or(0);
        assert!(read == of_csv, "{seed}: {:?}", [&read, &of_csv].map(|it| &it[at.saturating_sub(200)..it.len().min(at + 200)]));
        left_out += expected.fitted.left_out.len();
        validated += expected.validation.map_or(0, |rows| rows.rows());
        assert!(!expected.fitted.order.is_empty());
    }
    assert!(left_out > 16 * 20 && validated > 16 * 60, "{left_out} {validated}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// One column as numbers and as labels, all columns as numbers, no column; more rows than a batch.
#[test]
fn a_table_of_columns_is_the_table_of_the_same_csv() {
    let folder = folder("table");
    let path = folder.join("data");
    let rows = super::columns::BATCH + 1000;
    let random = &mut Random::new(5);
    let numbers = (0..rows).map(|_| (random.below(20) > 0).then(|| random.normal())).collect();
    let columns = [
        column("x[m]", Cells::F64(numbers), true),
        // Negative numbers in a Parquet file, which has no type without sign.
        column("u", Cells::U32((0..rows as u32).map(|row| Some(u32::MAX - row)).collect()), false),
        column("v", Cells::U64((0..rows as u64).map(|row| Some((1 << 63) + 2048 * row)).collect()), false),
        column("i", Cells::I32((0..rows as i32).map(|row| (row % 7 > 0).then_some(100 - row)).collect()), true),
        column("n", Cells::I64((0..rows as i64).map(|row| Some(row * row - 1_000_000)).collect()), false),
    ];
    let source = Source::new("data", csv(&columns));
    let labels = vec!["x".to_string(), "n".to_string()];
    let wanted = [
        Wanted { numbers: vec!["x".to_string()], labels, missing: MissingAs::Nan, ..Wanted::default() },
        Wanted { every_number: true, missing: MissingAs::Nan, ..Wanted::default() },
        Wanted::default(),
    ];
    let in_groups = Parquet { rows_of_group: 20_000, compression: Compression::SNAPPY, ..PLAIN };
    let in_batches = Arrow { rows_of_batch: 40_000, ..FILE };
    let writers: [&dyn Fn(); 5] = [
        &|| PLAIN.write(&path, &columns),
        &|| in_groups.write(&path, &columns),
        &|| FILE.write(&path, &columns),
        &|| in_batches.write(&path, &columns),
        &|| Arrow { is_stream: true, ..in_batches }.write(&path, &columns),
    ];
    for (k, write) in writers.iter().enumerate() {
        write();
        for wanted in &wanted {
            let expected = Table::read(&source, wanted).unwrap();
            let found = Content::read(&path).unwrap().table(wanted).unwrap();
            // Rows are counted from 1, and the first of a CSV is in line 2.
            assert_eq!((found.rows(), found.lines.last()), (expected.rows(), Some(&rows)), "{k}");
            assert!(format!("{:?}", found.columns) == format!("{:?}", expected.columns), "{k}");
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

fn sums_of(missing: &str, folder: &Path) -> Specification {
    let text = format!(
        "format = 1\nmodel = \"m\"\ndata = [\"data\"]\nmissing = \"{missing}\"\n[inputs.a]\nunit = \"cm\"\nrange = [0.0, 900.0]\n\
         [inputs.k]\nunit = \"1\"\nrange = [0.0, 9.0]\n[responses.y]\nunit = \"V\"\ninputs = [\"a\", \"k\"]\n\
         select = {{ method = \"fixed\", order = 2 }}\n"
    );
    Specification::from_source(Source::new("fit.toml", text), folder.into()).unwrap()
}

#[test]
fn a_part_of_columns_has_the_sums_of_the_same_csv() {
    let folder = folder("sums");
    let specification = sums_of("drop-row", &folder);
    let random = &mut Random::new(3);
    let rows = 80_000;
    let a: Vec<f64> = (0..rows).map(|_| 9.0 * random.share()).collect();
    let k: Vec<u64> = (0..rows).map(|_| random.below(10)).collect();
    let all_rows = a.iter().zip(&k).enumerate();
    let y = all_rows.map(|(row, (a, k))| (row % 1000 != 17).then_some(1.0 + a * *k as f64)).collect();
    let columns = [
        column("k[1]", Cells::U64(all(k)), false),
        column("y[V]", Cells::F64(y), true),
        column("a[m]", Cells::F64(all(a)), false),
    ];
    let expected = of_sources(&specification, &[Source::new("data", csv(&columns))]).unwrap().write();
    let sums = |text: &str| {
        let (_, sums) = text.split_once("[inputs.a]\nunit").unwrap();
        sums.split("[end]").next().unwrap().to_string()
    };
    assert!(sums(&expected).contains("rows_left_out = 80"));
    let path = folder.join("data");
    let same = |what: &str| {
        let found = of_files(&specification, &[&path], &mut |_| {}).unwrap().write();
        assert_eq!(sums(&found), sums(&expected), "{what}");
    };
    for compression in [Compression::UNCOMPRESSED, Compression::SNAPPY, Compression::ZSTD(ZstdLevel::default())] {
        Parquet { rows_of_group: 45_000, compression, ..PLAIN }.write(&path, &columns);
        same(&compression.to_string());
    }
    for is_stream in [false, true] {
        for compression in [None, Some(CompressionType::LZ4_FRAME), Some(CompressionType::ZSTD)] {
            Arrow { rows_of_batch: 70_000, compression, is_stream }.write(&path, &columns);
            same(&format!("{compression:?} {is_stream}"));
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Every fault in one message: of the header, of the types, of missing cells, of numbers that a table does not hold.
#[test]
fn what_a_file_does_not_hold_is_named() {
    let folder = folder("faults");
    let path = folder.join("data");
    let specification = sums_of("error", &folder);
    let refusals = |columns: &[Written]| {
        let mut said = Vec::new();
        for is_parquet in [true, false] {
            if is_parquet {
                PLAIN.write(&path, columns);
            } else {
                FILE.write(&path, columns);
            }
            said.push(fit(&specification, &mut |_| {}).unwrap_err().to_string());
            said.push(of_files(&specification, &[&path], &mut |_| {}).unwrap_err().to_string());
        }
        // A part names files without folders.
        let prefix = format!("{}", path.display());
        said.into_iter().map(|said| said.replace(&prefix, "data")).collect::<Vec<String>>()
    };
    let text = |rows: usize| Cells::Text(vec![Some("1".to_string()); rows], Text::Small);
    let float = |values: &[f64]| Cells::F64(all(values.to_vec()));
    // 2^53 + 1 is the smallest whole number that f64 does not hold.
    let (k, y) = (Cells::I64(all(vec![1, (1 << 53) + 1, 3])), Cells::F64(vec![Some(1.0), None, None]));
    let columns =
        [column("k[1]", k, true), column("y[V]", y, true), column("a[m]", float(&[1.0, 2.0, f64::NEG_INFINITY]), true)];
    for said in refusals(&columns) {
        for expected in [
            "data: column 1 `k`: row 2: found a number that f64 does not hold; no other cell of this column is refused",
            "data: column 2 `y`: row 2: found no number; 2 cells of this column are missing\n  help: fill the cells, or leave",
            "data: column 3 `a`: row 3: found a number that is not finite; no other",
        ] {
            assert!(said.contains(expected), "{said}");
        }
    }
    let columns = [column("k[1]", text(2), true), column("k [V]", float(&[1.0; 2]), true), column("a[m", text(2), false)];
    for said in refusals(&columns) {
        for expected in [
            "columns 1 and 2 are both named `k`",
            "column 3 is headed `a[m`, expected `name` or `name[unit]`",
            "column 1 `k`: found a type that is not a number",
            "there is no column `y`; the columns are `k`, `k`, `a`",
        ] {
            assert!(said.contains(expected), "{said}");
        }
    }
    for said in
        refusals(&[column("k[1]", float(&[]), true), column("y[V]", float(&[]), true), column("a[m]", float(&[]), true)])
    {
        assert!(said.contains("data: there is no row"), "{said}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_type_without_labels_is_a_fault_unless_any_type_may_be_there() {
    let headers = ["x".to_string(), "Run".to_string()];
    let of = |wanted: &Wanted| {
        let columns = super::columns::Columns::of("data", &headers, &|_| super::columns::Kind::Other, wanted);
        columns.map(|it| it.wanted.len()).map_err(|faults| faults.to_string())
    };
    let labels = Wanted { labels: vec!["x".into()], ..Wanted::default() };
    let said = of(&labels).unwrap_err();
    assert_eq!(said, "data: column 1 `x`: found a type that is no label, expected text, numbers or booleans");
    assert_eq!(of(&Wanted { any_label: true, ..labels }), Ok(0));
    // Nobody has asked for this column by its name.
    assert_eq!(of(&Wanted { run: true, ..Wanted::default() }), Ok(0));
    let said = of(&Wanted { every_number: true, any_label: true, ..Wanted::default() }).unwrap_err();
    assert!(said.contains("`x`: found a type that is not a number") && said.contains("column 2 `Run`"), "{said}");
}

/// Files that end too early, and files with changed bytes: an error or other numbers, and nothing worse.
#[test]
fn a_damaged_file_is_refused() {
    let folder = folder("damaged");
    let path = folder.join("data");
    let random = &mut Random::new(11);
    let columns = any_rows(random, 200, 1);
    let wanted = Wanted {
        numbers: vec!["a".into(), "k".into(), "y".into()],
        labels: vec!["rig".into(), "day".into()],
        missing: MissingAs::Nan,
        run: true,
        ..Wanted::default()
    };
    let read = || Content::read(&path).and_then(|content| content.table(&wanted)).map_err(|faults| faults.to_string());
    for round in 0..12 {
        let is_parquet = round % 2 == 0;
        if is_parquet {
            any_parquet(random).write(&path, &columns);
        } else {
            Arrow { is_stream: round % 4 == 1, ..any_arrow(random) }.write(&path, &columns);
        }
        let whole = std::fs::read(&path).unwrap();
        assert!(read().is_ok());
        for _ in 0..4 {
            // A stream without its end mark, and one that ends behind a batch, are whole.
            let end = 8 + random.below(whole.len() as u64 - 200) as usize;
            std::fs::write(&path, &whole[..end]).unwrap();
            match read() {
                Err(said) => assert!(said.contains("cannot be read"), "{said}"),
                Ok(table) => assert!(round % 4 == 1 && table.rows() < 200),
            }
        }
        for _ in 0..25 {
            let mut changed = whole.clone();
            for _ in 0..1 + random.below(3) {
                let at = 8 + random.below(whole.len() as u64 - 8) as usize;
                changed[at] = random.below(256) as u8;
            }
            std::fs::write(&path, changed).unwrap();
            let _ = read();
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
