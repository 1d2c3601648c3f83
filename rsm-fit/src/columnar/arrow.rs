//! Reads a file or a stream of Apache Arrow in batches of rows.
//!
//! In: a file, the wanted columns. Out: tables of some rows, in the order of the file. The memory depends on the size of a record batch of the file,
//! not on the number of batches. Needs the feature `arrow`, which is off by default.

use std::path::Path;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{
    ArrowPrimitiveType, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type, UInt32Type,
    UInt64Type,
};
use arrow_array::{Array, RecordBatch};
use arrow_ipc::reader::{FileReader, StreamReader};
use arrow_schema::{ArrowError, DataType, SchemaRef};
use rsm_core::source::{Faults, Source};

use super::columns::{BATCH, Columns, Kind, Values, label_of, whole};
use super::{Act, guarded};
use crate::table::Wanted;

/// Calls `act` with each batch of rows, and returns the number of all rows.
pub(super) fn read(name: &str, path: &Path, is_stream: bool, wanted: &Wanted, act: Act<'_>) -> Result<usize, Faults> {
    // The wanted columns are known only when the schema is read, so the file is opened twice.
    let schema = batches(name, path, is_stream, None)?.0;
    let headers: Vec<String> = schema.fields().iter().map(|field| field.name().clone()).collect();
    let mut columns = Columns::of(name, &headers, &|place| kind(schema.field(place).data_type()), wanted)?;
    let places = columns.wanted.iter().map(|column| column.place).collect();
    let mut batches = batches(name, path, is_stream, Some(places))?.1;
    while let Some(batch) = guarded(name, || batches.next().transpose())? {
        let mut done = 0;
        while done < batch.num_rows() {
            let count = BATCH.min(batch.num_rows() - done);
            let part = batch.slice(done, count);
            let all = columns.wanted.iter().zip(part.columns());
            let values = all.map(|(wanted, column)| Values {
                numbers: if wanted.is_number { numbers(column.as_ref()) } else { Vec::new() },
                labels: if wanted.is_label { (0..count).map(label(column.as_ref())).collect() } else { Vec::new() },
            });
            let values = values.collect();
            columns.add(count, values, act)?;
            done += count;
        }
    }
    columns.finish()
}

/// Record batches, one after another.
type Batches = Box<dyn Iterator<Item = Result<RecordBatch, ArrowError>>>;

/// The schema of a file, and its batches with some of its columns.
fn batches(name: &str, path: &Path, is_stream: bool, places: Option<Vec<usize>>) -> Result<(SchemaRef, Batches), Faults> {
    let file = Source::open(path)?;
    guarded(name, || {
        if is_stream {
            StreamReader::try_new_buffered(file, places).map(|it| (it.schema(), Box::new(it) as Batches))
        } else {
            FileReader::try_new_buffered(file, places).map(|it| (it.schema(), Box::new(it) as Batches))
        }
    })
}

/// What a column holds.
fn kind(data: &DataType) -> Kind {
    match data {
        DataType::Float32 | DataType::Float64 => Kind::Float,
        DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View | DataType::Boolean => Kind::Label,
        // A dictionary is a list of labels, also if these are numbers.
        DataType::Dictionary(_, values) if kind(values) != Kind::Other => Kind::Label,
        data if data.is_integer() => Kind::Whole,
        _ => Kind::Other,
    }
}

/// The values of a column of numbers, NaN where there is none.
fn numbers(column: &dyn Array) -> Vec<f64> {
    fn of<T: ArrowPrimitiveType>(column: &dyn Array, number: impl Fn(T::Native) -> f64) -> Vec<f64> {
        column.as_primitive::<T>().iter().map(|value| value.map_or(f64::NAN, &number)).collect()
    }
    match column.data_type() {
        DataType::Float64 => of::<Float64Type>(column, |value| value),
        DataType::Float32 => of::<Float32Type>(column, f64::from),
        DataType::Int8 => of::<Int8Type>(column, f64::from),
        DataType::Int16 => of::<Int16Type>(column, f64::from),
        DataType::Int32 => of::<Int32Type>(column, f64::from),
        DataType::Int64 => of::<Int64Type>(column, |value| whole(value.into())),
        DataType::UInt8 => of::<UInt8Type>(column, f64::from),
        DataType::UInt16 => of::<UInt16Type>(column, f64::from),
        DataType::UInt32 => of::<UInt32Type>(column, f64::from),
        DataType::UInt64 => of::<UInt64Type>(column, |value| whole(value.into())),
        // Only columns of numbers are asked for.
        _ => Vec::new(),
    }
}

/// The label of a row.
type Label<'a> = Box<dyn Fn(usize) -> String + 'a>;

/// The labels of a column by row, empty where there is no value.
fn label(column: &dyn Array) -> Label<'_> {
    fn of<T: ArrowPrimitiveType>(column: &dyn Array, text: impl Fn(T::Native) -> String + 'static) -> Label<'_> {
        let column = column.as_primitive::<T>();
        Box::new(move |row| text(column.value(row)))
    }
    // Cells of CSV are without blanks around them.
    let text: Label<'_> = match column.data_type() {
        DataType::Utf8 => Box::new(|row| column.as_string::<i32>().value(row).trim().to_string()),
        DataType::LargeUtf8 => Box::new(|row| column.as_string::<i64>().value(row).trim().to_string()),
        DataType::Utf8View => Box::new(|row| column.as_string_view().value(row).trim().to_string()),
        DataType::Boolean => Box::new(|row| column.as_boolean().value(row).to_string()),
        DataType::Float64 => of::<Float64Type>(column, label_of),
        DataType::Float32 => of::<Float32Type>(column, |value| label_of(value.into())),
        DataType::Int8 => of::<Int8Type>(column, |value| value.to_string()),
        DataType::Int16 => of::<Int16Type>(column, |value| value.to_string()),
        DataType::Int32 => of::<Int32Type>(column, |value| value.to_string()),
        DataType::Int64 => of::<Int64Type>(column, |value| value.to_string()),
        DataType::UInt8 => of::<UInt8Type>(column, |value| value.to_string()),
        DataType::UInt16 => of::<UInt16Type>(column, |value| value.to_string()),
        DataType::UInt32 => of::<UInt32Type>(column, |value| value.to_string()),
        DataType::UInt64 => of::<UInt64Type>(column, |value| value.to_string()),
        DataType::Dictionary(..) => {
            let dictionary = column.as_any_dictionary();
            let values = dictionary.values();
            // Without values every row is null.
            let keys = if values.is_empty() { Vec::new() } else { dictionary.normalized_keys() };
            let of_value = label(values.as_ref());
            Box::new(move |row| keys.get(row).map_or_else(String::new, |key| of_value(*key)))
        }
        // Only columns of labels are asked for.
        _ => Box::new(|_| String::new()),
    };
    Box::new(move |row| if column.is_null(row) { String::new() } else { text(row) })
}
