//! MAT files of version 7.3, which are HDF5 files: every array of numbers becomes columns.
//!
//! A structure is a group, a variable is a dataset whose attribute `MATLAB_class` gives its class (The MathWorks, "MAT-File Versions"). HDF5 lists
//! the slowest dimension first, MATLAB the fastest: the last dimension has the rows. Cells and objects are references; a note lists them.

use hdf5_pure::{AttrValue, DType, Dataset, File, Group};
use rsm_core::source::{Fault, Faults};

use crate::log::{Log, Raw};

/// The nesting limit; no record is nested so deeply.
const DEEPEST: usize = 16;

pub(crate) fn read(file: &str, bytes: &[u8]) -> Result<Log, Faults> {
    let fault = |error: hdf5_pure::Error| {
        Faults::one(Fault::whole_file(file, format!("cannot be read as a MAT file of version 7.3: {error}")))
    };
    let hdf = File::from_bytes(bytes.to_vec()).map_err(fault)?;
    let mut notes = vec!["MAT file, version 7.3 (HDF5)".to_string()];
    let mut columns = Vec::new();
    group(&hdf.root(), "", 0, &mut columns, &mut notes).map_err(fault)?;
    crate::mat::finish(file, columns, notes)
}

fn group(
    group_: &Group,
    path: &str,
    depth: usize,
    columns: &mut Vec<Raw>,
    notes: &mut Vec<String>,
) -> Result<(), hdf5_pure::Error> {
    let below = |name: &str| if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
    for name in group_.datasets()? {
        let dataset = group_.dataset(&name)?;
        match values(&dataset)? {
            Some((rows, values)) => crate::mat::columns(&below(&name), rows, &values, columns),
            None => notes.push(format!("`{}` is no array of numbers and is not read", below(&name))),
        }
    }
    for name in group_.groups()? {
        // `#refs#` and `#subsystem#` contain the targets of the references of cells and objects.
        if name.starts_with('#') || depth >= DEEPEST {
            continue;
        }
        group(&group_.group(&name)?, &below(&name), depth + 1, columns, notes)?;
    }
    Ok(())
}

/// Rows and numbers of a dataset; `None` for a dataset without numbers.
fn values(dataset: &Dataset) -> Result<Option<(usize, Vec<f64>)>, hdf5_pure::Error> {
    let class = match dataset.attrs()?.get("MATLAB_class") {
        Some(AttrValue::String(class) | AttrValue::AsciiString(class)) => class.clone(),
        _ => String::new(),
    };
    if matches!(class.as_str(), "char" | "cell" | "struct" | "function_handle" | "string") {
        return Ok(None);
    }
    let shape = dataset.shape()?;
    let values: Vec<f64> = match dataset.dtype()? {
        DType::F64 => dataset.read_f64()?,
        DType::F32 => dataset.read_f32()?.into_iter().map(f64::from).collect(),
        DType::I8 => dataset.read_i8()?.into_iter().map(f64::from).collect(),
        DType::U8 => dataset.read_u8()?.into_iter().map(f64::from).collect(),
        DType::I16 => dataset.read_i16()?.into_iter().map(f64::from).collect(),
        DType::U16 => dataset.read_u16()?.into_iter().map(f64::from).collect(),
        DType::I32 => dataset.read_i32()?.into_iter().map(f64::from).collect(),
        DType::U32 => dataset.read_u32()?.into_iter().map(f64::from).collect(),
        DType::I64 => dataset.read_i64()?.into_iter().map(|value| value as f64).collect(),
        DType::U64 => dataset.read_u64()?.into_iter().map(|value| value as f64).collect(),
        _ => return Ok(None),
    };
    Ok(Some((shape.last().map_or(1, |rows| *rows as usize), values)))
}
