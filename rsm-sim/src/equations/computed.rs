//! Expressions of a system as separate programs.
//!
//! In: a plant file, arguments, results. Out: [`Computed`], which computes the results from the arguments, with the same bits on every machine.

use rsm_core::lower;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::source::{Fault, Faults};
use rsm_core::tangent::{self, Variable};
use rsm_core::tape::{Reg, Tape, TapeBuilder};
use rsm_model::expression::{Id, Symbol};
use rsm_model::system::System;

use super::file::EquationFile;

/// Expressions of a system as a tape. It gives the same bits on every machine.
#[derive(Debug, Clone)]
pub(super) struct Computed {
    /// `None` if there is nothing to compute.
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

/// Surfaces that implement functions, in the order of the text.
#[derive(Debug, Clone)]
pub(super) struct Functions {
    tapes: Vec<Tape>,
}

impl Functions {
    pub(super) fn of(file: &EquationFile) -> Self {
        Functions { tapes: file.functions.iter().map(|it| lower::surface(&it.model, it.surface, Precision::F64)).collect() }
    }

    /// Writes a surface, differentiated with respect to each argument the given number of times.
    fn write(&self, builder: &mut TapeBuilder, surface: u32, arguments: &[Reg], orders: &[u8]) -> Option<Reg> {
        let mut tape = self.tapes.get(surface as usize)?.clone();
        for (place, order) in orders.iter().enumerate() {
            for _ in 0..*order {
                tape = tangent::tangent(&tape, &[Variable::Input(place)]);
                // The value is the first output, its derivative the second.
                tape.outputs.remove(0);
            }
        }
        tangent::write(builder, &tape, arguments, &[], &[]).values.first().copied()
    }

    /// Expressions as a tape; `None` if there is nothing to compute.
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
