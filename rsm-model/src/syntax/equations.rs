//! Equations of a model and statements of a function: text to tree.

use super::lexer::Token;
use super::parser::{Parser, Read};
use super::tree::{Equation, EquationKind, Kind, Statement, StatementKind};

impl Parser<'_> {
    /// Whether a list of equations or statements has ended.
    fn is_block_over(&self) -> bool {
        match self.token() {
            Token::Keyword(word) => match *word {
                "equation" | "algorithm" | "end" | "else" | "elseif" | "elsewhen" | "public" | "protected" | "external"
                | "annotation" => true,
                "initial" => matches!(self.ahead(), Token::Keyword("equation" | "algorithm")),
                _ => false,
            },
            _ => false,
        }
    }

    pub(crate) fn equations(&mut self) -> Vec<Equation> {
        self.list("an equation", Self::is_block_over, |parser| parser.deeper(Self::equation))
    }

    /// `end if` and similar.
    fn closes(&mut self, word: &str) -> Read<()> {
        if self.is_keyword("end") && matches!(self.ahead(), Token::Keyword(found) if *found == word) {
            self.advance();
            self.advance();
            return Ok(());
        }
        self.unexpected(&format!("`end {word}`"))
    }

    fn equation(&mut self) -> Read<Equation> {
        self.skip_decoration();
        let start = self.span().start;
        let kind = match self.token() {
            Token::Keyword("if") => {
                let (branches, otherwise) = self.branches("if", "elseif", Self::equations)?;
                EquationKind::If(branches, otherwise)
            }
            Token::Keyword("when") => {
                let (branches, _) = self.branches("when", "elsewhen", Self::equations)?;
                EquationKind::When(branches)
            }
            Token::Keyword("for") => {
                self.advance();
                let (index, range) = self.for_index()?;
                self.keyword("loop", "after the range of `for`")?;
                let body = self.equations();
                self.closes("for")?;
                EquationKind::For(index, range, body)
            }
            Token::Keyword("connect") => {
                let help = "flatten the component model first: `omc --baseModelica`, or rumoca's target `base-modelica`";
                return self.fault_with_help(
                    self.span(),
                    "`connect` is allowed in component models only, not in flat text",
                    help,
                );
            }
            _ => {
                let left = self.simple(start)?;
                self.skip_decoration();
                if self.is_sign(":=") {
                    let what = "found `:=` in an equation";
                    return self.fault_with_help(self.span(), what, "write `=`: an equation has no direction");
                }
                if self.takes_sign("=") {
                    EquationKind::Equal(left, self.expression()?)
                } else if matches!(left.kind, Kind::Call(..)) {
                    EquationKind::Call(left)
                } else {
                    return self.unexpected("`=` in an equation");
                }
            }
        };
        let span = self.since(start);
        self.comment()?;
        Ok(Equation { kind, span })
    }

    /// `if` or `when` with its further branches, up to `end`.
    #[expect(clippy::type_complexity, reason = "named nowhere else")]
    fn branches<T>(
        &mut self,
        opening: &str,
        further: &str,
        body: fn(&mut Self) -> Vec<T>,
    ) -> Read<(Vec<(super::tree::Expression, Vec<T>)>, Vec<T>)> {
        self.advance();
        let mut branches = Vec::new();
        loop {
            let condition = self.expression()?;
            self.keyword("then", &format!("after the condition of `{opening}`"))?;
            branches.push((condition, body(self)));
            if !self.takes_keyword(further) {
                break;
            }
        }
        let mut otherwise = Vec::new();
        if opening == "if" && self.takes_keyword("else") {
            otherwise = body(self);
        }
        self.closes(opening)?;
        Ok((branches, otherwise))
    }

    pub(crate) fn statements(&mut self) -> Vec<Statement> {
        self.list("a statement", Self::is_block_over, |parser| parser.deeper(Self::statement))
    }

    fn statement(&mut self) -> Read<Statement> {
        self.skip_decoration();
        let start = self.span().start;
        let kind = match self.token().clone() {
            Token::Keyword("if") => {
                let (branches, otherwise) = self.branches("if", "elseif", Self::statements)?;
                StatementKind::If(branches, otherwise)
            }
            Token::Keyword("for") => {
                self.advance();
                let (index, range) = self.for_index()?;
                self.keyword("loop", "after the range of `for`")?;
                let body = self.statements();
                self.closes("for")?;
                StatementKind::For(index, range, body)
            }
            Token::Keyword(word @ ("while" | "when" | "break" | "return")) => {
                let what = format!("`{word}` in a function is not supported: its operations must be one straight line");
                return self.fault_with_help(
                    self.span(),
                    what,
                    "write assignments and `if`; a `for` over known numbers is supported too",
                );
            }
            _ if self.is_sign("(") => {
                let what = "a call with several results is not supported";
                return self.fault_with_help(self.span(), what, "write a function for each result");
            }
            _ => {
                let place = self.span();
                let expression = self.simple(start)?;
                match expression.kind {
                    Kind::Name(parts) => {
                        if self.is_sign("=") {
                            return self.fault_with_help(
                                self.span(),
                                "found `=` in an algorithm",
                                "an assignment is written `:=`",
                            );
                        }
                        self.sign(":=", "in an assignment")?;
                        StatementKind::Assign(parts, self.expression()?)
                    }
                    Kind::Call(..) => StatementKind::Call(expression),
                    _ => return self.fault(place, "found an expression, expected a name and `:=`"),
                }
            }
        };
        let span = self.since(start);
        self.comment()?;
        Ok(Statement { kind, span })
    }
}
