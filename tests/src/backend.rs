//! Evaluators under comparison, in batches.
//!
//! In: a shared object with one symbol `batch_MODEL_FUNCTION` an evaluator, or functions in this process. Out: results for rows of points. The
//! rows of a step are a sequence: one state goes through them, from its start.

use std::path::Path;

use rsm_core::emit::{Function, Unit};
use rsm_core::run::Interpreter;

use crate::points::Number;

/// Something that evaluates the functions of models.
pub trait Backend<T>: Send + Sync {
    /// What a report calls it.
    fn name(&self) -> &str;
    /// The results of a function at rows of points; of a gradient and of an update a row each.
    fn evaluate(&self, unit: &Unit, function: &Function, points: &[T]) -> Vec<T>;
}

/// The reference.
#[derive(Debug)]
pub struct Reference;

impl<T: Number> Backend<T> for Reference {
    fn name(&self) -> &str {
        "interpreter"
    }

    fn evaluate(&self, _: &Unit, function: &Function, points: &[T]) -> Vec<T> {
        let mut interpreter = Interpreter::<T>::new(&function.tape);
        let start: Vec<T> = function.start().into_iter().map(T::from_constant).collect();
        interpreter.set_states(&start);
        let mut results = vec![];
        for point in points.chunks_exact(function.inputs.len()) {
            interpreter.step(point);
            results.extend(interpreter.results());
        }
        results
    }
}

/// Model, function, and the function over rows of arguments.
pub type Entry<T> = (&'static str, &'static str, fn(&[T]) -> Vec<T>);

/// Functions that are compiled into this process.
pub struct Linked<T: 'static> {
    name: String,
    functions: &'static [Entry<T>],
}

impl<T: 'static> Linked<T> {
    /// All functions of all models.
    #[must_use]
    pub fn new(name: &str, functions: &'static [Entry<T>]) -> Self {
        Linked { name: name.to_string(), functions }
    }
}

impl<T: Number> Backend<T> for Linked<T> {
    fn name(&self) -> &str {
        &self.name
    }

    fn evaluate(&self, unit: &Unit, function: &Function, points: &[T]) -> Vec<T> {
        let name = function.rust_name();
        let known = self.functions.iter().find(|(model, known, _)| *model == unit.model && *known == name);
        let (_, _, evaluate) = known.unwrap_or_else(|| panic!("{}: no function {}::{name}", self.name, unit.model));
        evaluate(points)
    }
}

/// A shared object.
#[derive(Debug)]
pub struct Loaded {
    name: String,
    library: libloading::Library,
}

/// `void batch_m_s(const T *points, T *results, size_t count)`
type Batch<T> = unsafe extern "C" fn(*const T, *mut T, usize);

impl Loaded {
    /// Opens a shared object that a compiler of [`crate::compilers`] made.
    ///
    /// # Panics
    /// When it cannot be opened.
    #[must_use]
    #[allow(unsafe_code)]
    pub fn open(name: &str, file: &Path) -> Self {
        // SAFETY: the file was compiled from emitted text and our own batch functions; it has no initialisers.
        let library = unsafe { libloading::Library::new(file) }.unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        Loaded { name: name.to_string(), library }
    }

    /// The result of a function `int f(void)`, such as a self-test.
    ///
    /// # Panics
    /// When there is no such function.
    #[must_use]
    #[allow(unsafe_code)]
    pub fn call(&self, symbol: &str) -> i32 {
        // SAFETY: the callers name functions that are emitted or written with this type.
        unsafe {
            let function: libloading::Symbol<'_, unsafe extern "C" fn() -> i32> =
                self.library.get(symbol.as_bytes()).unwrap_or_else(|error| panic!("{symbol}: {error}"));
            function()
        }
    }
}

impl<T: Number> Backend<T> for Loaded {
    fn name(&self) -> &str {
        &self.name
    }

    #[allow(unsafe_code)]
    fn evaluate(&self, unit: &Unit, function: &Function, points: &[T]) -> Vec<T> {
        let count = points.len() / function.inputs.len();
        let mut results = vec![T::nearest(0.0); count * function.tape.outputs.len()];
        let symbol = format!("batch_{}_{}", unit.model, function.rust_name());
        // SAFETY: the batch functions of [`crate::compilers`] have this type; they read `count` rows of the function's number of
        // arguments and write `count` rows of results.
        unsafe {
            let batch: libloading::Symbol<'_, Batch<T>> =
                self.library.get(symbol.as_bytes()).unwrap_or_else(|error| panic!("{symbol}: {error}"));
            batch(points.as_ptr(), results.as_mut_ptr(), count);
        }
        results
    }
}
