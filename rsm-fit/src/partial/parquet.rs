//! Reads a Parquet file in batches of rows.
//!
//! In: a file, the wanted columns. Out: tables of some rows, in the order of the file. The memory depends on the size of a page, not on the number of
//! rows. A column is named as in the header of a CSV, `name[unit]`. Numbers are f64 exactly: a whole number beyond 2^53 that f64 does not hold is
//! refused. Needs the feature `parquet`, which is off by default.

use std::io::Read as _;
use std::path::Path;

use rsm_core::source::{Fault, Faults, Source};

use crate::compressed::PARQUET;
use crate::table::{Table, Wanted};

/// Whether a file is one of Parquet.
pub(super) fn is_parquet(path: &Path) -> bool {
    let mut first = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(4).read_to_end(&mut first));
    read.is_ok() && first == PARQUET
}

/// Calls `act` with each batch of rows, and returns the number of all rows.
#[cfg(not(feature = "parquet"))]
pub(super) fn read(
    name: &str,
    path: &Path,
    _: &Wanted,
    _: &mut dyn FnMut(&Table) -> Result<(), Faults>,
) -> Result<usize, Faults> {
    Source::open(path)?;
    let fault = Fault::whole_file(name, "is a Parquet file, which this build does not read");
    Err(Faults::one(fault.help("build it with `--features parquet`, or export CSV, which may be compressed with gzip")))
}

#[cfg(feature = "parquet")]
pub(super) use on::read;

#[cfg(feature = "parquet")]
mod on {
    use parquet::basic::{LogicalType, Type as Physical};
    use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
    use parquet::data_type::DataType;
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::schema::types::ColumnDescriptor;

    use super::{Fault, Faults, Path, Source, Table, Wanted};
    use crate::missing::MissingAs;
    use crate::table::Column;

    /// The number of rows of a batch: some MB of numbers.
    const BATCH: usize = 1 << 15;

    pub(in crate::partial) fn read(
        name: &str,
        path: &Path,
        wanted: &Wanted,
        act: &mut dyn FnMut(&Table) -> Result<(), Faults>,
    ) -> Result<usize, Faults> {
        let whole = |what: String| Faults::one(Fault::whole_file(name, what));
        let broken = |error: parquet::errors::ParquetError| whole(format!("cannot be read: {error}"));
        let file = SerializedFileReader::new(Source::open(path)?).map_err(broken)?;
        let schema = file.metadata().file_metadata().schema_descr_ptr();
        let headers: Vec<(String, Option<String>)> =
            schema.columns().iter().map(|column| split(&column.path().string())).collect();
        let mut places = Vec::new();
        for wanted in &wanted.numbers {
            let Some(place) = headers.iter().position(|(name, _)| name == wanted) else {
                let names: Vec<String> = headers.iter().map(|(name, _)| format!("`{name}`")).collect();
                return Err(whole(format!("there is no column `{wanted}`; the columns are {}", names.join(", "))));
            };
            if !is_number(&schema.column(place)) {
                return Err(whole(format!("column {} `{wanted}`: found a type that is not a number", place + 1)));
            }
            if !places.contains(&place) {
                places.push(place);
            }
        }
        let mut rows = 0;
        for group in 0..file.num_row_groups() {
            let group = file.get_row_group(group).map_err(broken)?;
            let readers = places.iter().map(|place| group.get_column_reader(*place));
            let mut readers: Vec<ColumnReader> = readers.collect::<Result<_, _>>().map_err(broken)?;
            let mut left = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            while left > 0 {
                let count = left.min(BATCH);
                let mut columns = Vec::new();
                for (place, reader) in places.iter().zip(&mut readers) {
                    let nullable = schema.column(*place).max_def_level();
                    let values = batch(reader, count, nullable).map_err(broken)?;
                    if values.len() != count {
                        return Err(whole("its columns have different numbers of rows".to_string()));
                    }
                    let (column, unit) = headers[*place].clone();
                    let is_bad = |value: &f64| value.is_infinite() || value.is_nan() && wanted.missing != MissingAs::Nan;
                    if let Some(at) = values.iter().position(is_bad) {
                        let found = if values[at].is_nan() { "no number" } else { "a number that f64 does not hold" };
                        let what = format!("column {} `{column}`: row {}: found {found}", place + 1, rows + at + 1);
                        let fault = Fault::whole_file(name, what);
                        return Err(Faults::one(fault.help("`missing = \"drop-row\"` leaves rows without a number out")));
                    }
                    columns.push(Column { name: column, unit, place: place + 1, values, labels: Vec::new() });
                }
                let lines = (rows + 1..=rows + count).collect();
                act(&Table { file: name.to_string(), header_line: 0, columns, lines })?;
                (rows, left) = (rows + count, left - count);
            }
        }
        Ok(rows)
    }

    /// `name[unit]`.
    fn split(header: &str) -> (String, Option<String>) {
        match header.strip_suffix(']').and_then(|header| header.split_once('[')) {
            Some((name, unit)) => (name.trim().to_string(), Some(unit.trim().to_string())),
            None => (header.trim().to_string(), None),
        }
    }

    fn is_number(column: &ColumnDescriptor) -> bool {
        let is_plain = matches!(column.logical_type_ref(), None | Some(LogicalType::Integer { .. }));
        let physical = [Physical::DOUBLE, Physical::FLOAT, Physical::INT32, Physical::INT64];
        is_plain && column.max_rep_level() == 0 && physical.contains(&column.physical_type())
    }

    fn batch(reader: &mut ColumnReader, count: usize, nullable: i16) -> parquet::errors::Result<Vec<f64>> {
        // A whole number that f64 does not hold becomes infinite, which is refused.
        let whole = |value: i64| if value as f64 as i128 == i128::from(value) { value as f64 } else { f64::INFINITY };
        match reader {
            ColumnReader::DoubleColumnReader(reader) => numbers(reader, count, nullable, |value| value),
            ColumnReader::FloatColumnReader(reader) => numbers(reader, count, nullable, f64::from),
            ColumnReader::Int32ColumnReader(reader) => numbers(reader, count, nullable, f64::from),
            ColumnReader::Int64ColumnReader(reader) => numbers(reader, count, nullable, whole),
            _ => Ok(Vec::new()),
        }
    }

    /// The values of some rows, NaN where there is none.
    fn numbers<T: DataType>(
        reader: &mut ColumnReaderImpl<T>,
        count: usize,
        nullable: i16,
        number: impl Fn(T::T) -> f64,
    ) -> parquet::errors::Result<Vec<f64>> {
        let mut found = Vec::with_capacity(count);
        while found.len() < count {
            let (mut levels, mut values) = (Vec::new(), Vec::new());
            let wanted = count - found.len();
            let (records, _, _) = reader.read_records(wanted, (nullable > 0).then_some(&mut levels), None, &mut values)?;
            if records == 0 {
                break;
            }
            let mut values = values.into_iter().map(&number);
            if nullable == 0 {
                found.extend(values);
            } else {
                found.extend(
                    levels.iter().map(|level| if *level == nullable { values.next().unwrap_or(f64::NAN) } else { f64::NAN }),
                );
            }
        }
        Ok(found)
    }

    #[cfg(test)]
    mod tests {
        use std::sync::Arc;

        use parquet::basic::{Compression, Repetition, ZstdLevel};
        use parquet::data_type::{DoubleType, Int64Type};
        use parquet::file::properties::WriterProperties;
        use parquet::file::writer::SerializedFileWriter;
        use parquet::schema::types::Type;

        use crate::partial::{of_files, of_sources};
        use crate::random::Random;
        use crate::spec::Specification;
        use rsm_core::source::Source;

        #[test]
        fn a_parquet_file_has_the_sums_of_the_same_csv() {
            let folder = std::env::temp_dir().join(format!("rsm-parquet-{}", std::process::id()));
            std::fs::create_dir_all(&folder).unwrap();
            let text = "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\nmissing = \"drop-row\"\n[inputs.a]\nunit = \"cm\"\nrange = [0.0, 900.0]\n\
                [inputs.k]\nunit = \"1\"\nrange = [0.0, 9.0]\n[responses.y]\nunit = \"V\"\ninputs = [\"a\", \"k\"]\nselect = { method = \"fixed\", order = 2 }\n";
            let specification = Specification::from_source(Source::new("fit.toml", text), folder.clone()).unwrap();
            let field = |name: &str, physical, repetition| {
                Arc::new(Type::primitive_type_builder(name, physical).with_repetition(repetition).build().unwrap())
            };
            let fields = vec![
                field("a[m]", super::Physical::DOUBLE, Repetition::REQUIRED),
                field("k[1]", super::Physical::INT64, Repetition::REQUIRED),
                field("y[V]", super::Physical::DOUBLE, Repetition::OPTIONAL),
            ];
            let schema = Arc::new(Type::group_type_builder("rows").with_fields(fields).build().unwrap());
            let mut random = Random::new(3);
            let mut csv = "a[m],k[1],y[V]\n".to_string();
            let path = folder.join("data.parquet");
            let zstd = Compression::ZSTD(ZstdLevel::default());
            for compression in [Compression::UNCOMPRESSED, Compression::SNAPPY, zstd] {
                let properties = WriterProperties::builder().set_compression(compression).build();
                let file = std::fs::File::create(&path).unwrap();
                let mut writer = SerializedFileWriter::new(file, schema.clone(), Arc::new(properties)).unwrap();
                csv.truncate(15);
                // Two groups of rows, of more than one batch.
                for _ in 0..2 {
                    let a: Vec<f64> = (0..40_000).map(|_| 9.0 * random.share()).collect();
                    let k: Vec<i64> = (0..40_000).map(|_| random.below(10) as i64).collect();
                    let has: Vec<i16> = (0..40_000).map(|row| i16::from(row % 1000 != 17)).collect();
                    let y: Vec<f64> = a.iter().zip(&k).map(|(a, k)| 1.0 + a * *k as f64).collect();
                    for row in 0..40_000 {
                        let cell = if has[row] == 1 { y[row].to_string() } else { String::new() };
                        csv += &format!("{},{},{cell}\n", a[row], k[row]);
                    }
                    let y: Vec<f64> = y.iter().zip(&has).filter(|(_, has)| **has == 1).map(|(y, _)| *y).collect();
                    let mut group = writer.next_row_group().unwrap();
                    let mut column = group.next_column().unwrap().unwrap();
                    column.typed::<DoubleType>().write_batch(&a, None, None).unwrap();
                    column.close().unwrap();
                    let mut column = group.next_column().unwrap().unwrap();
                    column.typed::<Int64Type>().write_batch(&k, None, None).unwrap();
                    column.close().unwrap();
                    let mut column = group.next_column().unwrap().unwrap();
                    column.typed::<DoubleType>().write_batch(&y, Some(&has), None).unwrap();
                    column.close().unwrap();
                    group.close().unwrap();
                }
                writer.close().unwrap();
                let found = of_files(&specification, &[&path], &mut |_| {}).unwrap().write();
                let expected = of_sources(&specification, &[Source::new("data.csv", csv.clone())]).unwrap().write();
                let sums = |text: &str| {
                    let (_, sums) = text.split_once("[inputs.a]\nunit").unwrap();
                    sums.split("[end]").next().unwrap().replace("data.parquet", "data.csv")
                };
                assert!(sums(&found).contains("rows_left_out = 80"), "{}", &found[..2000]);
                assert_eq!(sums(&found), sums(&expected), "{compression}");
            }
            std::fs::remove_dir_all(&folder).unwrap();
        }
    }
}
