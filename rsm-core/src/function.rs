//! The elementary functions by name.
//!
//! In: a name. Out: the function and its number of arguments. [`crate::elementary`] writes its operations and gives its accuracy.

/// A function of one number; `Atan2` has two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Function {
    /// The square root.
    Sqrt,
    /// e to the argument.
    Exp,
    /// The natural logarithm.
    Log,
    /// The logarithm to the base 10.
    Log10,
    /// The sine of an angle in rad.
    Sin,
    /// The cosine of an angle in rad.
    Cos,
    /// The tangent of an angle in rad.
    Tan,
    /// The angle in rad, -pi/2 to pi/2, with this sine.
    Asin,
    /// The angle in rad, 0 to pi, with this cosine.
    Acos,
    /// The angle in rad, -pi/2 to pi/2, with this tangent.
    Atan,
    /// Of y and x: the angle in rad, -pi to pi, of the point (x, y).
    Atan2,
    /// The hyperbolic sine.
    Sinh,
    /// The hyperbolic cosine.
    Cosh,
    /// The hyperbolic tangent.
    Tanh,
    /// The largest integer that is not above the argument.
    Floor,
}

impl Function {
    /// All of them.
    pub const ALL: [Function; 15] = {
        use Function::*;
        [Sqrt, Exp, Log, Log10, Sin, Cos, Tan, Asin, Acos, Atan, Atan2, Sinh, Cosh, Tanh, Floor]
    };

    /// The name in equations.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Function::Sqrt => "sqrt",
            Function::Exp => "exp",
            Function::Log => "log",
            Function::Log10 => "log10",
            Function::Sin => "sin",
            Function::Cos => "cos",
            Function::Tan => "tan",
            Function::Asin => "asin",
            Function::Acos => "acos",
            Function::Atan => "atan",
            Function::Atan2 => "atan2",
            Function::Sinh => "sinh",
            Function::Cosh => "cosh",
            Function::Tanh => "tanh",
            Function::Floor => "floor",
        }
    }

    /// The function with this name.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|function| function.name() == name)
    }

    /// The number of its arguments.
    #[must_use]
    pub fn arity(self) -> usize {
        if self == Function::Atan2 { 2 } else { 1 }
    }
}
