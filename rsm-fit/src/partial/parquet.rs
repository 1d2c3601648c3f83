//! Reads a Parquet file in batches of rows.
//!
//! In: a file, the wanted columns. Out: tables of some rows, in the order of the file. The memory depends on the size of a page, not on the number of
//! rows. Needs the feature `parquet`, which is off by default.

use parquet::basic::{ConvertedType, LogicalType, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;
use rsm_core::source::{Fault, Faults, Source};

use std::path::Path;

use super::columns::{BATCH, Columns, whole};
use crate::table::{Table, Wanted};

/// Calls `act` with each batch of rows, and returns the number of all rows.
pub(super) fn read(
    name: &str,
    path: &Path,
    wanted: &Wanted,
    act: &mut dyn FnMut(&Table) -> Result<(), Faults>,
) -> Result<usize, Faults> {
    let broken =
        |error: parquet::errors::ParquetError| Faults::one(Fault::whole_file(name, format!("cannot be read: {error}")));
    let file = SerializedFileReader::new(Source::open(path)?).map_err(broken)?;
    let schema = file.metadata().file_metadata().schema_descr_ptr();
    let headers = schema.columns().iter().map(|column| column.path().string());
    let columns = Columns::of(name, headers, &|place| is_number(&schema.column(place)), wanted)?;
    let mut rows = 0;
    for group in 0..file.num_row_groups() {
        let group = file.get_row_group(group).map_err(broken)?;
        let readers = columns.places.iter().map(|place| group.get_column_reader(*place));
        let mut readers: Vec<ColumnReader> = readers.collect::<Result<_, _>>().map_err(broken)?;
        let mut left = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        while left > 0 {
            let count = left.min(BATCH);
            let mut values = Vec::new();
            for (place, reader) in columns.places.iter().zip(&mut readers) {
                let nullable = schema.column(*place).max_def_level();
                values.push(batch(reader, count, nullable, is_unsigned(&schema.column(*place))).map_err(broken)?);
            }
            act(&columns.table(rows, count, values)?)?;
            (rows, left) = (rows + count, left - count);
        }
    }
    Ok(rows)
}

fn is_number(column: &ColumnDescriptor) -> bool {
    use ConvertedType::{INT_8, INT_16, INT_32, INT_64, NONE};
    let is_plain = matches!(column.logical_type_ref(), None | Some(LogicalType::Integer(_)))
        && (is_unsigned(column) || [NONE, INT_8, INT_16, INT_32, INT_64].contains(&column.converted_type()));
    let physical = [Physical::DOUBLE, Physical::FLOAT, Physical::INT32, Physical::INT64];
    is_plain && column.max_rep_level() == 0 && physical.contains(&column.physical_type())
}

/// Whether a column holds whole numbers without sign. The largest of them are negative numbers in the file.
fn is_unsigned(column: &ColumnDescriptor) -> bool {
    use ConvertedType::{UINT_8, UINT_16, UINT_32, UINT_64};
    [UINT_8, UINT_16, UINT_32, UINT_64].contains(&column.converted_type())
}

fn batch(reader: &mut ColumnReader, count: usize, nullable: i16, is_unsigned: bool) -> parquet::errors::Result<Vec<f64>> {
    match reader {
        ColumnReader::DoubleColumnReader(reader) => numbers(reader, count, nullable, |value| value),
        ColumnReader::FloatColumnReader(reader) => numbers(reader, count, nullable, f64::from),
        ColumnReader::Int32ColumnReader(reader) if is_unsigned => {
            numbers(reader, count, nullable, |value| f64::from(value as u32))
        }
        ColumnReader::Int64ColumnReader(reader) if is_unsigned => {
            numbers(reader, count, nullable, |value| whole((value as u64).into()))
        }
        ColumnReader::Int32ColumnReader(reader) => numbers(reader, count, nullable, f64::from),
        ColumnReader::Int64ColumnReader(reader) => numbers(reader, count, nullable, |value| whole(value.into())),
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
    use parquet::data_type::{DoubleType, Int32Type, Int64Type};
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

    #[test]
    fn whole_numbers_without_sign_are_not_negative() {
        let folder = std::env::temp_dir().join(format!("rsm-parquet-unsigned-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let text = "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n[inputs.n]\nunit = \"1\"\nrange = [0.0, 5e9]\n\
            [responses.y]\nunit = \"1\"\ninputs = [\"n\"]\nselect = { method = \"fixed\", order = 1 }\n";
        let specification = Specification::from_source(Source::new("fit.toml", text), folder.clone()).unwrap();
        let field = |name: &str, converted| {
            let builder = Type::primitive_type_builder(name, super::Physical::INT32).with_repetition(Repetition::REQUIRED);
            Arc::new(builder.with_converted_type(converted).build().unwrap())
        };
        let fields = vec![field("n", super::ConvertedType::UINT_32), field("y", super::ConvertedType::NONE)];
        let schema = Arc::new(Type::group_type_builder("rows").with_fields(fields).build().unwrap());
        let path = folder.join("data.parquet");
        let file = std::fs::File::create(&path).unwrap();
        let mut writer = SerializedFileWriter::new(file, schema, Arc::new(WriterProperties::builder().build())).unwrap();
        let mut group = writer.next_row_group().unwrap();
        for values in [[1_i32, 3_000_000_000_u32 as i32, 7], [-5, 2, 3]] {
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<Int32Type>().write_batch(&values, None, None).unwrap();
            column.close().unwrap();
        }
        group.close().unwrap();
        writer.close().unwrap();
        let found = of_files(&specification, &[&path], &mut |_| {}).unwrap();
        assert_eq!((found.spans[0], found.sums[0].span), ([1.0, 3e9], [-5.0, 3.0]));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
