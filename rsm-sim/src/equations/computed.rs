//! Expressions of a system as programs of their own.
//!
//! In: a plant file, arguments, results. Out: [`Computed`], which gives the results for arguments: the same bits wherever it runs.

use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::{Fault, Faults};
use rsm_core::tangent::{self, Variable};
use rsm_core::tape::{Reg, Tape, TapeBuilder};
use rsm_model::expression::{Id, Symbol};
use rsm_model::system::System;

use super::file::EquationFile;

/// Expressions of a system as a tape: the same bits wherever it runs.
#[derive(Debug, Clone)]
pub(super) struct Computed {
    /// `None` where there is nothing to compute.
    pub tape: Option<Tape>,
    pub arguments: usize,
}

impl Computed {
    pub(super) fn values(&self, arguments: &[f64]) -> Vec<f64> {
        debug_assert_eq!(arguments.len(), self.arguments);
        let Some(tape) = &self.tape else { return Vec::new() };
        let mut results = vec![0.0; tape.outputs.len()];
        Interpreter::<f64>::new(tape).eval_all(arguments, &mut results);
        results
    }
}

/// Surfaces that stand for functions, in the order of the text.
#[derive(Debug, Clone)]
pub(super) struct Functions {
    tapes: Vec<Tape>,
}

impl Functions {
    pub(super) fn of(file: &EquationFile) -> Self {
        Functions { tapes: file.functions.iter().map(|it| lower::surface(&it.model, it.surface, Precision::F64)).collect() }
    }

    /// Writes a surface, derived by each argument so often.
    fn write(&self, builder: &mut TapeBuilder, surface: u32, arguments: &[Reg], orders: &[u8]) -> Option<Reg> {
        let mut tape = self.tapes.get(surface as usize)?.clone();
        for (place, order) in orders.iter().enumerate() {
            for _ in 0..*order {
                tape = tangent::tangent(&tape, &[Variable::Input(place)]);
                // The value stands first, its derivative second.
                tape.outputs.remove(0);
            }
        }
        tangent::write(builder, &tape, arguments, &[], &[]).values.first().copied()
    }

    /// Expressions as a tape; `None` where there is nothing to compute.
    pub(super) fn tape(&self, system: &System, arguments: &[Symbol], results: &[Id]) -> Result<Option<Tape>, String> {
        let named: Vec<(String, Id)> = results.iter().enumerate().map(|(k, id)| (format!("result {k}"), *id)).collect();
        if named.is_empty() {
            return Ok(None);
        }
        let write = &mut |builder: &mut TapeBuilder, surface: u32, list: &[Reg], orders: &[u8]| {
            self.write(builder, surface, list, orders)
        };
        system.tape("plant", arguments, &named, write).map(Some)
    }

    pub(super) fn compiled(
        &self,
        file: &EquationFile,
        system: &System,
        arguments: &[Symbol],
        results: &[Id],
    ) -> Result<Computed, Faults> {
        let tape = self.tape(system, arguments, results).map_err(|what| Faults::one(Fault::whole_file(&file.file, what)))?;
        Ok(Computed { tape, arguments: arguments.len() })
    }
}
