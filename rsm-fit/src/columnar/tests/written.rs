//! Rows that a test writes as CSV, Parquet or Arrow.
//!
//! In: columns of cells. Out: the text of a CSV, written by rules of its own, and files by the writers of the formats.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use arrow_array::types::Int32Type as Key;
use arrow_array::{
    ArrayRef, BooleanArray, DictionaryArray, Float32Array, Float64Array, Int32Array, Int64Array, LargeStringArray, RecordBatch,
    StringArray, StringViewArray, UInt32Array, UInt64Array,
};
use arrow_ipc::CompressionType;
use arrow_ipc::writer::{FileWriter, IpcWriteOptions, StreamWriter};
use arrow_schema::{Field, Schema};
use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type};
use parquet::file::properties::{WriterProperties, WriterVersion};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

/// The cells of a column, `None` where one is missing.
#[derive(Clone)]
pub(super) enum Cells {
    F64(Vec<Option<f64>>),
    F32(Vec<Option<f32>>),
    I32(Vec<Option<i32>>),
    I64(Vec<Option<i64>>),
    U32(Vec<Option<u32>>),
    U64(Vec<Option<u64>>),
    Bool(Vec<Option<bool>>),
    /// Text, and how Arrow holds it.
    Text(Vec<Option<String>>, Text),
}

/// How Arrow holds a text.
#[derive(Clone, Copy)]
pub(super) enum Text {
    Small,
    Large,
    View,
    Dictionary,
}

/// A column with its header.
#[derive(Clone)]
pub(super) struct Written {
    pub(super) header: &'static str,
    pub(super) cells: Cells,
    /// Whether the file says that cells may be missing.
    pub(super) is_nullable: bool,
}

/// The same for every type of cells.
macro_rules! each {
    ($cells:expr, $of:ident => $what:expr) => {
        match $cells {
            Cells::F64($of) => $what,
            Cells::F32($of) => $what,
            Cells::I32($of) => $what,
            Cells::I64($of) => $what,
            Cells::U32($of) => $what,
            Cells::U64($of) => $what,
            Cells::Bool($of) => $what,
            Cells::Text($of, _) => $what,
        }
    };
}

impl Cells {
    fn rows(&self) -> usize {
        each!(self, cells => cells.len())
    }

    fn csv(&self, row: usize) -> String {
        fn of<T>(cell: &Option<T>, text: impl Fn(&T) -> String) -> String {
            cell.as_ref().map_or(String::new(), text)
        }
        match self {
            Cells::F64(cells) => of(&cells[row], |cell| format!("{cell:?}")),
            Cells::F32(cells) => of(&cells[row], |cell| format!("{:?}", f64::from(*cell))),
            Cells::Text(cells, _) => of(&cells[row], |cell| format!("\"{cell}\"")),
            Cells::I32(cells) => of(&cells[row], i32::to_string),
            Cells::I64(cells) => of(&cells[row], i64::to_string),
            Cells::U32(cells) => of(&cells[row], u32::to_string),
            Cells::U64(cells) => of(&cells[row], u64::to_string),
            Cells::Bool(cells) => of(&cells[row], bool::to_string),
        }
    }

    fn arrow(&self) -> ArrayRef {
        match self {
            Cells::F64(cells) => Arc::new(Float64Array::from(cells.clone())),
            Cells::F32(cells) => Arc::new(Float32Array::from(cells.clone())),
            Cells::I32(cells) => Arc::new(Int32Array::from(cells.clone())),
            Cells::I64(cells) => Arc::new(Int64Array::from(cells.clone())),
            Cells::U32(cells) => Arc::new(UInt32Array::from(cells.clone())),
            Cells::U64(cells) => Arc::new(UInt64Array::from(cells.clone())),
            Cells::Bool(cells) => Arc::new(BooleanArray::from(cells.clone())),
            Cells::Text(cells, text) => {
                let cells = cells.iter().map(Option::as_deref);
                match text {
                    Text::Small => Arc::new(cells.collect::<StringArray>()),
                    Text::Large => Arc::new(cells.collect::<LargeStringArray>()),
                    Text::View => Arc::new(cells.collect::<StringViewArray>()),
                    Text::Dictionary => Arc::new(cells.collect::<DictionaryArray<Key>>()),
                }
            }
        }
    }

    fn parquet(&self) -> (Physical, ConvertedType) {
        match self {
            Cells::F64(_) => (Physical::DOUBLE, ConvertedType::NONE),
            Cells::F32(_) => (Physical::FLOAT, ConvertedType::NONE),
            Cells::I32(_) => (Physical::INT32, ConvertedType::NONE),
            Cells::I64(_) => (Physical::INT64, ConvertedType::NONE),
            Cells::U32(_) => (Physical::INT32, ConvertedType::UINT_32),
            Cells::U64(_) => (Physical::INT64, ConvertedType::UINT_64),
            Cells::Bool(_) => (Physical::BOOLEAN, ConvertedType::NONE),
            Cells::Text(..) => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
        }
    }

    /// Some rows of the next column of a group.
    fn write(&self, [from, end]: [usize; 2], is_nullable: bool, group: &mut SerializedRowGroupWriter<'_, File>) {
        fn of<D: DataType, T>(
            cells: &[Option<T>],
            value: impl Fn(&T) -> D::T,
            is_nullable: bool,
            group: &mut SerializedRowGroupWriter<'_, File>,
        ) {
            let levels: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
            let values: Vec<D::T> = cells.iter().flatten().map(value).collect();
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<D>().write_batch(&values, is_nullable.then_some(&levels), None).unwrap();
            column.close().unwrap();
        }
        match self {
            Cells::F64(cells) => of::<DoubleType, _>(&cells[from..end], |value| *value, is_nullable, group),
            Cells::F32(cells) => of::<FloatType, _>(&cells[from..end], |value| *value, is_nullable, group),
            Cells::I32(cells) => of::<Int32Type, _>(&cells[from..end], |value| *value, is_nullable, group),
            Cells::I64(cells) => of::<Int64Type, _>(&cells[from..end], |value| *value, is_nullable, group),
            Cells::U32(cells) => of::<Int32Type, _>(&cells[from..end], |value| *value as i32, is_nullable, group),
            Cells::U64(cells) => of::<Int64Type, _>(&cells[from..end], |value| *value as i64, is_nullable, group),
            Cells::Bool(cells) => of::<BoolType, _>(&cells[from..end], |value| *value, is_nullable, group),
            Cells::Text(cells, _) => of::<ByteArrayType, _>(&cells[from..end], |it| it.as_str().into(), is_nullable, group),
        }
    }
}

/// A CSV of some columns.
pub(super) fn csv(columns: &[Written]) -> String {
    let headers: Vec<&str> = columns.iter().map(|column| column.header).collect();
    let mut text = headers.join(",") + "\n";
    for row in 0..columns[0].cells.rows() {
        let cells: Vec<String> = columns.iter().map(|column| column.cells.csv(row)).collect();
        text += &(cells.join(",") + "\n");
    }
    text
}

/// How a Parquet file is written.
pub(super) struct Parquet {
    pub(super) rows_of_group: usize,
    pub(super) rows_of_page: usize,
    pub(super) compression: Compression,
    pub(super) has_dictionary: bool,
    pub(super) version: WriterVersion,
}

impl Parquet {
    pub(super) fn write(&self, path: &Path, columns: &[Written]) {
        let field = |column: &Written| {
            let (physical, converted) = column.cells.parquet();
            let repetition = if column.is_nullable { Repetition::OPTIONAL } else { Repetition::REQUIRED };
            let builder = Type::primitive_type_builder(column.header, physical).with_repetition(repetition);
            Arc::new(builder.with_converted_type(converted).build().unwrap())
        };
        let fields = columns.iter().map(field).collect();
        let schema = Arc::new(Type::group_type_builder("rows").with_fields(fields).build().unwrap());
        let properties = WriterProperties::builder()
            .set_compression(self.compression)
            .set_dictionary_enabled(self.has_dictionary)
            .set_data_page_row_count_limit(self.rows_of_page)
            .set_write_batch_size(self.rows_of_page.min(1024))
            .set_writer_version(self.version);
        let file = File::create(path).unwrap();
        let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties.build())).unwrap();
        let rows = columns[0].cells.rows();
        for from in (0..rows).step_by(self.rows_of_group) {
            let mut group = writer.next_row_group().unwrap();
            for column in columns {
                column.cells.write([from, rows.min(from + self.rows_of_group)], column.is_nullable, &mut group);
            }
            group.close().unwrap();
        }
        writer.close().unwrap();
    }
}

/// How a file or a stream of Arrow is written.
pub(super) struct Arrow {
    pub(super) rows_of_batch: usize,
    pub(super) compression: Option<CompressionType>,
    pub(super) is_stream: bool,
}

impl Arrow {
    pub(super) fn write(&self, path: &Path, columns: &[Written]) {
        let arrays: Vec<ArrayRef> = columns.iter().map(|column| column.cells.arrow()).collect();
        let fields: Vec<Field> = columns
            .iter()
            .zip(&arrays)
            .map(|(column, array)| Field::new(column.header, array.data_type().clone(), column.is_nullable))
            .collect();
        let schema = Arc::new(Schema::new(fields));
        let all = RecordBatch::try_new(schema.clone(), arrays).unwrap();
        let rows = all.num_rows();
        let starts = (0..rows).step_by(self.rows_of_batch);
        let batches = starts.map(|from| all.slice(from, self.rows_of_batch.min(rows - from)));
        let options = IpcWriteOptions::default().try_with_compression(self.compression).unwrap();
        let file = File::create(path).unwrap();
        if self.is_stream {
            let mut writer = StreamWriter::try_new_with_options(file, &schema, options).unwrap();
            batches.for_each(|batch| writer.write(&batch).unwrap());
            writer.finish().unwrap();
        } else {
            let mut writer = FileWriter::try_new_with_options(file, &schema, options).unwrap();
            batches.for_each(|batch| writer.write(&batch).unwrap());
            writer.finish().unwrap();
        }
    }
}
