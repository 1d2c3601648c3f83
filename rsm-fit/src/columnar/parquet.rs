//! Reads a Parquet file in batches of rows.
//!
//! In: a file, the wanted columns. Out: tables of some rows, in the order of the file. The memory depends on the size of a page, not on the number of
//! rows. Needs the feature `parquet`, which is off by default.

use parquet::basic::{Compression, ConvertedType, LogicalType, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::Result as ReadResult;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;
use rsm_core::source::{Fault, Faults, Source};

use std::path::Path;

use super::columns::{BATCH, Columns, Kind, Values, WantedColumn, label_of, whole};
use super::{Act, guarded};
use crate::table::Wanted;

/// Calls `act` with each batch of rows, and returns the number of all rows.
pub(super) fn read(name: &str, path: &Path, wanted: &Wanted, act: Act<'_>) -> Result<usize, Faults> {
    let file = Source::open(path)?;
    let file = guarded(name, || SerializedFileReader::new(file))?;
    let schema = file.metadata().file_metadata().schema_descr_ptr();
    let headers: Vec<String> = schema.columns().iter().map(|column| column.path().string()).collect();
    let mut columns = Columns::of(name, &headers, &|place| kind(&schema.column(place)), wanted)?;
    for group in 0..file.num_row_groups() {
        let group = guarded(name, || file.get_row_group(group))?;
        for column in &columns.wanted {
            let compression = group.metadata().column(column.place).compression();
            let known = [Compression::UNCOMPRESSED, Compression::SNAPPY];
            if !known.contains(&compression) && !matches!(compression, Compression::GZIP(_) | Compression::ZSTD(_)) {
                let compression = compression.to_string();
                let found = compression.split('(').next().unwrap_or_default();
                let what = format!("column {} `{}`: found the compression {found}", column.place + 1, headers[column.place]);
                let fault = Fault::whole_file(name, format!("{what}, expected none, Snappy, gzip or Zstandard"));
                return Err(Faults::one(fault.help("write the file with `snappy`, `gzip` or `zstd`")));
            }
        }
        let readers = columns.wanted.iter().map(|column| group.get_column_reader(column.place));
        let mut readers: Vec<ColumnReader> = guarded(name, || readers.collect::<ReadResult<_>>())?;
        let mut left = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        while left > 0 {
            let count = left.min(BATCH);
            let all = columns.wanted.iter().zip(&mut readers);
            let values = all.map(|(wanted, reader)| batch(reader, count, wanted, &schema.column(wanted.place)));
            let values = guarded(name, || values.collect::<ReadResult<Vec<Values>>>())?;
            columns.add(count, values, act)?;
            left -= count;
        }
    }
    columns.finish()
}

/// What a column holds.
fn kind(column: &ColumnDescriptor) -> Kind {
    use ConvertedType::{ENUM, INT_8, INT_16, INT_32, INT_64, NONE, UTF8};
    let (logical, converted) = (column.logical_type_ref(), column.converted_type());
    let is_plain = matches!(logical, None | Some(LogicalType::Integer(_)))
        && (is_unsigned(column) || [NONE, INT_8, INT_16, INT_32, INT_64].contains(&converted));
    let is_text = matches!(logical, Some(LogicalType::String | LogicalType::Enum)) || [UTF8, ENUM].contains(&converted);
    match column.physical_type() {
        _ if column.max_rep_level() > 0 => Kind::Other,
        Physical::INT32 | Physical::INT64 if is_plain => Kind::Whole,
        Physical::DOUBLE | Physical::FLOAT if is_plain => Kind::Float,
        Physical::BOOLEAN => Kind::Label,
        Physical::BYTE_ARRAY if is_text => Kind::Label,
        _ => Kind::Other,
    }
}

/// Whether a column holds whole numbers without sign. The largest of them are negative numbers in the file.
fn is_unsigned(column: &ColumnDescriptor) -> bool {
    use ConvertedType::{UINT_8, UINT_16, UINT_32, UINT_64};
    [UINT_8, UINT_16, UINT_32, UINT_64].contains(&column.converted_type())
}

/// The next rows of a column.
fn batch(reader: &mut ColumnReader, count: usize, wanted: &WantedColumn, column: &ColumnDescriptor) -> ReadResult<Values> {
    let next = Next { count, wanted, nullable: column.max_def_level() };
    let is_unsigned = is_unsigned(column);
    match reader {
        ColumnReader::DoubleColumnReader(reader) => next.values(reader, |value| *value, |value| Ok(label_of(*value))),
        ColumnReader::FloatColumnReader(reader) => {
            next.values(reader, |value| f64::from(*value), |value| Ok(label_of(f64::from(*value))))
        }
        ColumnReader::Int32ColumnReader(reader) if is_unsigned => {
            next.values(reader, |value| f64::from(*value as u32), |value| Ok((*value as u32).to_string()))
        }
        ColumnReader::Int64ColumnReader(reader) if is_unsigned => {
            next.values(reader, |value| whole((*value as u64).into()), |value| Ok((*value as u64).to_string()))
        }
        ColumnReader::Int32ColumnReader(reader) => {
            next.values(reader, |value| f64::from(*value), |value| Ok(value.to_string()))
        }
        ColumnReader::Int64ColumnReader(reader) => {
            next.values(reader, |value| whole((*value).into()), |value| Ok(value.to_string()))
        }
        ColumnReader::BoolColumnReader(reader) => next.values(reader, |_| f64::NAN, |value| Ok(value.to_string())),
        ColumnReader::ByteArrayColumnReader(reader) => {
            // Cells of CSV are without blanks around them.
            next.values(reader, |_| f64::NAN, |value| Ok(value.as_utf8()?.trim().to_string()))
        }
        _ => Ok(Values::default()),
    }
}

/// The rows that are read next of a column.
struct Next<'a> {
    count: usize,
    wanted: &'a WantedColumn,
    /// The level of a value that is there; 0 if every value is.
    nullable: i16,
}

impl Next<'_> {
    fn values<T: DataType>(
        &self,
        reader: &mut ColumnReaderImpl<T>,
        number: impl Fn(&T::T) -> f64,
        label: impl Fn(&T::T) -> ReadResult<String>,
    ) -> ReadResult<Values> {
        let (mut levels, mut values) = (Vec::new(), Vec::new());
        reader.read_records(self.count, (self.nullable > 0).then_some(&mut levels), None, &mut values)?;
        let mut found = Values::default();
        if self.wanted.is_number {
            found.numbers = self.placed(&levels, values.iter().map(number), || f64::NAN);
        }
        if self.wanted.is_label {
            let labels: Vec<String> = values.iter().map(label).collect::<Result<_, _>>()?;
            found.labels = self.placed(&levels, labels.into_iter(), String::new);
        }
        Ok(found)
    }

    /// The values in their rows.
    fn placed<V>(&self, levels: &[i16], mut values: impl Iterator<Item = V>, absent: impl Fn() -> V) -> Vec<V> {
        if self.nullable == 0 {
            return values.collect();
        }
        let value = |level: &i16| if *level == self.nullable { values.next() } else { None };
        levels.iter().map(value).map(|value| value.unwrap_or_else(&absent)).collect()
    }
}
