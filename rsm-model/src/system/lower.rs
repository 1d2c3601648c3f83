//! Expressions to a tape.
//!
//! All decisions about arithmetic are made here: the operations of an expression in the order of the pool, elementary functions as rows of the tape,
//! a general power as exp(b log(a)), a condition as a selection. Numbers of the text keep the bits with which they were read.

use std::collections::HashMap;

use rsm_core::elementary::{self, Function};
use rsm_core::number::{Precision, exact};
use rsm_core::tape::{Reg, Tape, TapeBuilder};

use crate::expression::{Binary, Id, Node, Pool, Symbol, Unary};

use super::System;

/// Writes a response surface: its number, the registers of its arguments, the order of differentiation with respect to each. `None` if it does not
/// exist.
pub type SurfaceRows<'s> = &'s mut dyn FnMut(&mut TapeBuilder, u32, &[Reg], &[u8]) -> Option<Reg>;

struct Lowering<'p> {
    pool: &'p Pool,
    tape: TapeBuilder,
    registers: HashMap<Id, Reg>,
}

impl System {
    /// The tape in f64 that computes some named expressions from some arguments.
    ///
    /// ```
    /// use rsm_core::{run::Interpreter, source::Source};
    /// use rsm_model::{flat::{Flat, Options}, system::System};
    ///
    /// let text = "model Swing\n  Real x(start = 0.1), v;\nequation\n  der(x) = v;\n  der(v) = -9.81*sin(x);\nend Swing;\n";
    /// let system = System::new(&Flat::read(&Source::new("swing.mo", text), &Options::default())?)?;
    /// let rates = system.rates();
    /// let results = [("x".to_string(), rates[0]), ("v".to_string(), rates[1])];
    /// let tape = system.tape("rates", system.states(), &results, &mut |_, _, _, _| None).unwrap();
    /// let mut found = [0.0; 2];
    /// Interpreter::<f64>::new(&tape).eval_all(&[0.5, 2.0], &mut found);
    /// assert_eq!(found, [2.0, -9.81 * 0.479425538604203]);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    ///
    /// # Errors
    /// If an expression needs a symbol that is no argument, or a surface that does not exist; as a sentence.
    ///
    /// # Panics
    /// If there are no results.
    pub fn tape(
        &self,
        name: &str,
        arguments: &[Symbol],
        results: &[(String, Id)],
        surfaces: SurfaceRows<'_>,
    ) -> Result<Tape, String> {
        let pool = &self.flat.pool;
        let mut lowering = Lowering { pool, tape: TapeBuilder::sharing(Precision::F64), registers: HashMap::new() };
        let place: HashMap<Symbol, u32> = arguments.iter().enumerate().map(|(k, symbol)| (*symbol, k as u32)).collect();
        let roots: Vec<Id> = results.iter().map(|(_, id)| *id).collect();
        for id in pool.reachable(&roots) {
            let register = match pool.node(id) {
                Node::Symbol(symbol) => {
                    let Some(port) = place.get(&symbol) else {
                        return Err(format!("`{name}` needs `{}`, which is not one of its arguments", self.name(symbol)));
                    };
                    lowering.tape.input(*port)
                }
                Node::Surface(surface, list) => {
                    let (arguments, orders) = pool.list(list);
                    let arguments: Vec<Reg> = arguments.iter().map(|argument| lowering.number(*argument)).collect();
                    match surfaces(&mut lowering.tape, surface, &arguments, orders) {
                        Some(register) => register,
                        None => {
                            return Err(format!(
                                "no model file contains the surface `{}`",
                                self.flat.surfaces[surface as usize].name
                            ));
                        }
                    }
                }
                _ => match lowering.node(id) {
                    Some(register) => register,
                    // A condition is written where it is used.
                    None => continue,
                },
            };
            lowering.registers.insert(id, register);
        }
        let results: Vec<(String, Reg)> = results.iter().map(|(name, id)| (name.clone(), lowering.number(*id))).collect();
        let inputs = arguments.iter().map(|symbol| self.name(*symbol).to_string()).collect();
        Ok(lowering.tape.finish_with_results(name, inputs, results, [] as [(String, Reg); 0]))
    }
}

impl Lowering<'_> {
    fn constant(&mut self, value: f64) -> Reg {
        self.tape.constant(exact(value))
    }

    /// The register of an expression; a condition becomes 1 or 0.
    fn number(&mut self, id: Id) -> Reg {
        if let Some(register) = self.registers.get(&id) {
            return *register;
        }
        let (one, zero) = (self.constant(1.0), self.constant(0.0));
        let register = self.select(id, one, zero);
        self.registers.insert(id, register);
        register
    }

    /// Selects one of two registers by a condition.
    fn select(&mut self, condition: Id, then: Reg, otherwise: Reg) -> Reg {
        match self.pool.node(condition) {
            Node::Binary(Binary::Less | Binary::LessNow, a, b) => {
                let (a, b) = (self.number(a), self.number(b));
                self.tape.select_less(a, b, then, otherwise)
            }
            Node::Unary(Unary::Not, inner) => self.select(inner, otherwise, then),
            Node::Binary(Binary::And, a, b) => {
                let inner = self.select(b, then, otherwise);
                self.select(a, inner, otherwise)
            }
            Node::Binary(Binary::Or, a, b) => {
                let inner = self.select(b, then, otherwise);
                self.select(a, then, inner)
            }
            _ => {
                // A Boolean that is an argument or a selected value: 1 or 0.
                let (half, value) = (self.constant(0.5), self.number(condition));
                self.tape.select_less(half, value, then, otherwise)
            }
        }
    }

    /// The register of a node whose operands are written; `None` for a condition.
    fn node(&mut self, id: Id) -> Option<Reg> {
        Some(match self.pool.node(id) {
            Node::Number(bits) => self.constant(f64::from_bits(bits)),
            Node::Unary(Unary::Not, _) | Node::Binary(Binary::Less | Binary::LessNow | Binary::And | Binary::Or, ..) => {
                return None;
            }
            Node::Unary(operation, a) => {
                let a = self.number(a);
                self.unary(operation, a)
            }
            Node::Binary(operation, a, b) => {
                let (a, b) = (self.number(a), self.number(b));
                self.binary(operation, a, b)
            }
            Node::If(condition, then, otherwise) => {
                let (then, otherwise) = (self.number(then), self.number(otherwise));
                self.select(condition, then, otherwise)
            }
            Node::Symbol(_) | Node::Surface(..) => unreachable!("written by the caller"),
        })
    }

    fn unary(&mut self, operation: Unary, a: Reg) -> Reg {
        let function = match operation {
            Unary::Negate => return self.tape.negate(a),
            Unary::Absolute => return self.tape.absolute(a),
            Unary::Sign => return elementary::sign(&mut self.tape, a),
            Unary::Root => Function::Sqrt,
            Unary::Sine => Function::Sin,
            Unary::Cosine => Function::Cos,
            Unary::Tangent => Function::Tan,
            Unary::Arcsine => Function::Asin,
            Unary::Arccosine => Function::Acos,
            Unary::Arctangent => Function::Atan,
            Unary::SineHyperbolic => Function::Sinh,
            Unary::CosineHyperbolic => Function::Cosh,
            Unary::TangentHyperbolic => Function::Tanh,
            Unary::Exponential => Function::Exp,
            Unary::Logarithm => Function::Log,
            Unary::Logarithm10 => Function::Log10,
            Unary::Floor => Function::Floor,
            Unary::Not => unreachable!("a condition is written where it decides"),
        };
        elementary::write(&mut self.tape, function, &[a])
    }

    fn binary(&mut self, operation: Binary, a: Reg, b: Reg) -> Reg {
        match operation {
            Binary::Add => self.tape.add(a, b),
            Binary::Subtract => self.tape.subtract(a, b),
            Binary::Multiply => self.tape.multiply(a, b),
            Binary::Divide => self.tape.divide(a, b),
            Binary::Minimum => elementary::minimum(&mut self.tape, a, b),
            Binary::Maximum => elementary::maximum(&mut self.tape, a, b),
            Binary::Arctangent2 => elementary::write(&mut self.tape, Function::Atan2, &[a, b]),
            Binary::Power => {
                let logarithm = elementary::write(&mut self.tape, Function::Log, &[a]);
                let product = self.tape.multiply(b, logarithm);
                elementary::write(&mut self.tape, Function::Exp, &[product])
            }
            Binary::Less | Binary::LessNow | Binary::And | Binary::Or => {
                unreachable!("a condition is written where it decides")
            }
        }
    }
}
