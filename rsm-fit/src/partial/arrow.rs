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
use rsm_core::source::{Fault, Faults, Source};

use super::columns::{BATCH, Columns, whole};
use crate::table::{Table, Wanted};

/// Calls `act` with each batch of rows, and returns the number of all rows.
pub(super) fn read(
    name: &str,
    path: &Path,
    is_stream: bool,
    wanted: &Wanted,
    act: &mut dyn FnMut(&Table) -> Result<(), Faults>,
) -> Result<usize, Faults> {
    let broken = |error: ArrowError| Faults::one(Fault::whole_file(name, format!("cannot be read: {error}")));
    // The wanted columns are known only when the schema is read, so the file is opened twice.
    let schema = batches(path, is_stream, None)?.map_err(broken)?.0;
    let headers = schema.fields().iter().map(|field| field.name().clone());
    let columns = Columns::of(name, headers, &|place| is_number(schema.field(place).data_type()), wanted)?;
    let mut rows = 0;
    for batch in batches(path, is_stream, Some(columns.places.clone()))?.map_err(broken)?.1 {
        let batch = batch.map_err(broken)?;
        let mut done = 0;
        while done < batch.num_rows() {
            let count = BATCH.min(batch.num_rows() - done);
            let part = batch.slice(done, count);
            let values = part.columns().iter().map(|column| numbers(column.as_ref())).collect();
            act(&columns.table(rows, count, values)?)?;
            (rows, done) = (rows + count, done + count);
        }
    }
    Ok(rows)
}

/// Record batches, one after another.
type Batches = Box<dyn Iterator<Item = Result<RecordBatch, ArrowError>>>;

/// The schema of a file, and its batches with some of its columns.
fn batches(
    path: &Path,
    is_stream: bool,
    places: Option<Vec<usize>>,
) -> Result<Result<(SchemaRef, Batches), ArrowError>, Faults> {
    let file = Source::open(path)?;
    Ok(if is_stream {
        StreamReader::try_new_buffered(file, places).map(|it| (it.schema(), Box::new(it) as Batches))
    } else {
        FileReader::try_new_buffered(file, places).map(|it| (it.schema(), Box::new(it) as Batches))
    })
}

fn is_number(data: &DataType) -> bool {
    data.is_integer() || matches!(data, DataType::Float32 | DataType::Float64)
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

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::path::PathBuf;
    use std::sync::Arc;

    use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray, UInt64Array};
    use arrow_ipc::CompressionType;
    use arrow_ipc::writer::{FileWriter, IpcWriteOptions, StreamWriter};
    use arrow_schema::{DataType, Field, Schema};

    use crate::partial::{of_files, of_sources};
    use crate::random::Random;
    use crate::spec::Specification;
    use rsm_core::source::Source;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("rsm-arrow-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn specification(folder: &std::path::Path, missing: &str) -> Specification {
        let text = format!(
            "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\nmissing = \"{missing}\"\n[inputs.a]\nunit = \"cm\"\nrange = [0.0, 900.0]\n\
             [inputs.k]\nunit = \"1\"\nrange = [0.0, 9.0]\n[responses.y]\nunit = \"V\"\ninputs = [\"a\", \"k\"]\n\
             select = {{ method = \"fixed\", order = 2 }}\n"
        );
        Specification::from_source(Source::new("fit.toml", text), folder.into()).unwrap()
    }

    /// Columns in another order than the specification names them, and one that it does not name.
    fn batch(k: Vec<u64>, y: Vec<Option<f64>>, a: Vec<f64>) -> RecordBatch {
        let field = |name: &str, data: DataType, nullable| Field::new(name, data, nullable);
        let schema = Schema::new(vec![
            field("k[1]", DataType::UInt64, false),
            field("note", DataType::Utf8, true),
            field("y[V]", DataType::Float64, true),
            field("a[m]", DataType::Float64, false),
        ]);
        let notes: Vec<Option<&str>> = k.iter().map(|k| (*k > 3).then_some("warm")).collect();
        let columns: Vec<ArrayRef> = vec![
            Arc::new(UInt64Array::from(k)),
            Arc::new(StringArray::from(notes)),
            Arc::new(Float64Array::from(y)),
            Arc::new(Float64Array::from(a)),
        ];
        RecordBatch::try_new(Arc::new(schema), columns).unwrap()
    }

    fn write(path: &std::path::Path, batches: &[RecordBatch], compression: Option<CompressionType>, is_stream: bool) {
        let file = File::create(path).unwrap();
        let schema = batches[0].schema();
        let options = IpcWriteOptions::default().try_with_compression(compression).unwrap();
        if is_stream {
            let mut writer = StreamWriter::try_new_with_options(file, &schema, options).unwrap();
            batches.iter().for_each(|batch| writer.write(batch).unwrap());
            writer.finish().unwrap();
        } else {
            let mut writer = FileWriter::try_new_with_options(file, &schema, options).unwrap();
            batches.iter().for_each(|batch| writer.write(batch).unwrap());
            writer.finish().unwrap();
        }
    }

    #[test]
    fn an_arrow_file_or_stream_has_the_sums_of_the_same_csv() {
        let folder = folder("sums");
        let specification = specification(&folder, "drop-row");
        let mut random = Random::new(3);
        let mut csv = "a[m],k[1],y[V]\n".to_string();
        let mut batches = Vec::new();
        // A batch of less than a table of rows, and one of more.
        for rows in [10_000, 70_000] {
            let a: Vec<f64> = (0..rows).map(|_| 9.0 * random.share()).collect();
            let k: Vec<u64> = (0..rows).map(|_| random.below(10)).collect();
            let all = a.iter().zip(&k).enumerate();
            let y: Vec<Option<f64>> = all.map(|(row, (a, k))| (row % 1000 != 17).then_some(1.0 + a * *k as f64)).collect();
            for row in 0..rows {
                csv += &format!("{},{},{}\n", a[row], k[row], y[row].map_or(String::new(), |y| y.to_string()));
            }
            batches.push(batch(k, y, a));
        }
        let expected = of_sources(&specification, &[Source::new("data.csv", csv)]).unwrap().write();
        let sums = |text: &str| {
            let (_, sums) = text.split_once("[inputs.a]\nunit").unwrap();
            sums.split("[end]").next().unwrap().replace("data.arrow", "data.csv")
        };
        assert!(sums(&expected).contains("rows_left_out = 80"));
        let path = folder.join("data.arrow");
        for is_stream in [false, true] {
            for compression in [None, Some(CompressionType::LZ4_FRAME), Some(CompressionType::ZSTD)] {
                write(&path, &batches, compression, is_stream);
                let found = of_files(&specification, &[&path], &mut |_| {}).unwrap().write();
                assert_eq!(sums(&found), sums(&expected), "{compression:?} {is_stream}");
            }
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_an_arrow_file_does_not_hold_is_named() {
        let folder = folder("faults");
        let path = folder.join("data.arrow");
        let refusal = |missing: &str| {
            let found = of_files(&specification(&folder, missing), &[&path], &mut |_| {});
            found.err().map(|it| it.to_string()).unwrap_or_default()
        };
        write(&path, &[batch(vec![1, 2], vec![Some(1.0), None], vec![1.0, 2.0])], None, false);
        assert!(refusal("error").contains("column 3 `y`: row 2: found no number"), "{}", refusal("error"));
        // 2^53 + 1 is the smallest whole number that f64 does not hold.
        write(&path, &[batch(vec![1, (1 << 53) + 1], vec![Some(1.0); 2], vec![1.0, 2.0])], None, true);
        assert!(
            refusal("error").contains("column 1 `k`: row 2: found a number that f64 does not hold"),
            "{}",
            refusal("error")
        );
        // A file that ends in the middle.
        write(&path, &[batch(vec![1; 500], vec![Some(1.0); 500], vec![1.0; 500])], None, false);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        assert!(refusal("error").contains("cannot be read"), "{}", refusal("error"));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
