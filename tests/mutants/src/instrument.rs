//! A source file that contains all its mutants, each with a switch.
//!
//! In: the text of a source file, the number of the first mutant, the numbers that did not compile. Out: the text with the switches, and the mutants.
//! A mutant is one change of meaning: `a < b` becomes `if on(7) { a <= b } else { a < b }`. The changed branch contains the original operands without
//! switches, because only one mutant is active at a time. So the size of a file grows with the depth of its expressions, not exponentially (mutant
//! schemata, Untch, Offutt and Harrold 1993).
//!
//! Never changed: tests, the values of constants (their uses are changed), patterns, types, attributes, and the arguments of macros.

use std::collections::BTreeSet;

use proc_macro2::Span;
use quote::ToTokens;
use syn::spanned::Spanned;
use syn::visit_mut::{self, VisitMut};
use syn::{BinOp, Expr, Lit, ReturnType, Stmt, Type, UnOp, parse_quote};

/// One change of meaning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Mutant {
    /// The number of its switch.
    pub(crate) number: usize,
    /// The path from the root of the workspace.
    pub(crate) file: String,
    /// Line and column, counted from 1, in the original.
    pub(crate) line: usize,
    pub(crate) column: usize,
    /// The function that contains it.
    pub(crate) function: String,
    /// The change as a comment names it: `< to <=`.
    pub(crate) change: String,
}

/// The text of a file with its mutants, and the number after the last one. This number does not depend on the omitted mutants.
pub(crate) fn instrument(
    text: &str,
    file: &str,
    first: usize,
    left_out: &BTreeSet<usize>,
) -> Result<(String, Vec<Mutant>, usize), String> {
    let mut tree = syn::parse_file(text).map_err(|error| format!("{file}:{}: {error}", error.span().start().line))?;
    let mut writer = Writer { file, next: first, left_out, function: String::new(), mutants: Vec::new() };
    writer.visit_file_mut(&mut tree);
    Ok((prettyplease::unparse(&tree), writer.mutants, writer.next))
}

struct Writer<'a> {
    file: &'a str,
    next: usize,
    left_out: &'a BTreeSet<usize>,
    function: String,
    mutants: Vec<Mutant>,
}

impl Writer<'_> {
    /// The switch of a new mutant; `None` if it is known not to compile.
    fn switch(&mut self, span: Span, change: &str) -> Option<Expr> {
        let number = self.next;
        self.next += 1;
        if self.left_out.contains(&number) {
            return None;
        }
        let start = span.start();
        self.mutants.push(Mutant {
            number,
            file: self.file.to_owned(),
            line: start.line,
            column: start.column + 1,
            function: self.function.clone(),
            change: change.to_owned(),
        });
        Some(parse_quote!(crate::mutant_switch::on(#number)))
    }

    /// Wraps `now`, which may already contain switches, so that each change has a switch.
    fn offer(&mut self, now: &mut Expr, span: Span, changes: Vec<(String, Expr)>) {
        for (change, changed) in changes {
            if let Some(on) = self.switch(span, &change) {
                let plain = std::mem::replace(now, Expr::PLACEHOLDER);
                // In parentheses, because at the start of a block `if c { 1.0 } else { 2.0 } / x` is a statement followed by other tokens.
                *now = parse_quote!((if #on { (#changed) } else { (#plain) }));
            }
        }
    }

    fn body(&mut self, output: &ReturnType, block: &mut syn::Block, name: &syn::Ident) {
        let outer = std::mem::replace(&mut self.function, name.to_string());
        let mut values = results(output);
        // A body that is already the value would not be changed.
        if let [Stmt::Expr(only, None)] = block.stmts.as_slice() {
            values.retain(|value| quiet(value) != quiet(only));
        }
        visit_mut::visit_block_mut(self, block);
        for value in values {
            let words = quiet(&value);
            if let Some(on) = self.switch(name.span(), &format!("body to {words}")) {
                block.stmts.insert(0, parse_quote!(if #on { return #value; }));
            }
        }
        self.function = outer;
    }
}

impl VisitMut for Writer<'_> {
    fn visit_item_mut(&mut self, item: &mut syn::Item) {
        match item {
            syn::Item::Fn(function) if is_test(&function.attrs) || function.sig.constness.is_some() => {}
            syn::Item::Fn(function) => {
                let name = function.sig.ident.clone();
                self.body(&function.sig.output.clone(), &mut function.block, &name);
            }
            syn::Item::Mod(module) if is_test(&module.attrs) => {}
            syn::Item::Impl(block) if is_test(&block.attrs) => {}
            syn::Item::Const(_) | syn::Item::Static(_) | syn::Item::Enum(_) | syn::Item::Struct(_) => {}
            _ => visit_mut::visit_item_mut(self, item),
        }
    }

    fn visit_impl_item_mut(&mut self, item: &mut syn::ImplItem) {
        if let syn::ImplItem::Fn(function) = item
            && function.sig.constness.is_none()
            && !is_test(&function.attrs)
        {
            let name = function.sig.ident.clone();
            self.body(&function.sig.output.clone(), &mut function.block, &name);
        }
    }

    fn visit_trait_item_mut(&mut self, item: &mut syn::TraitItem) {
        if let syn::TraitItem::Fn(function) = item
            && let Some(block) = &mut function.default
        {
            self.body(&function.sig.output.clone(), block, &function.sig.ident.clone());
        }
    }

    // Values that the compiler must know, and code that is not an expression.
    fn visit_type_mut(&mut self, _: &mut Type) {}
    fn visit_pat_mut(&mut self, _: &mut syn::Pat) {}
    fn visit_attribute_mut(&mut self, _: &mut syn::Attribute) {}
    fn visit_generics_mut(&mut self, _: &mut syn::Generics) {}
    fn visit_generic_argument_mut(&mut self, _: &mut syn::GenericArgument) {}
    fn visit_expr_const_mut(&mut self, _: &mut syn::ExprConst) {}
    fn visit_macro_mut(&mut self, _: &mut syn::Macro) {}

    fn visit_expr_repeat_mut(&mut self, repeat: &mut syn::ExprRepeat) {
        self.visit_expr_mut(&mut repeat.expr);
    }

    fn visit_local_mut(&mut self, local: &mut syn::Local) {
        if let Some(init) = &mut local.init {
            self.visit_local_init_mut(init);
        }
    }

    fn visit_arm_mut(&mut self, arm: &mut syn::Arm) {
        if let Some((_, guard)) = &mut arm.guard
            && !holds_let(guard)
        {
            let span = guard.span();
            self.visit_expr_mut(guard);
            let changes =
                vec![("guard to true".to_owned(), parse_quote!(true)), ("guard to false".to_owned(), parse_quote!(false))];
            self.offer(guard, span, changes);
        }
        self.visit_expr_mut(&mut arm.body);
    }

    fn visit_expr_match_mut(&mut self, choice: &mut syn::ExprMatch) {
        let last_takes_all = choice.arms.last().is_some_and(|arm| arm.guard.is_none() && takes_all(&arm.pat));
        visit_mut::visit_expr_match_mut(self, choice);
        let count = choice.arms.len();
        for arm in choice.arms.iter_mut().take(if last_takes_all { count - 1 } else { 0 }) {
            if arm.guard.is_some() {
                continue;
            }
            if let Some(on) = self.switch(arm.pat.span(), "arm deleted") {
                arm.guard = Some((syn::token::If::default(), Box::new(parse_quote!(!#on))));
            }
        }
    }

    fn visit_stmt_mut(&mut self, statement: &mut Stmt) {
        let plain = statement.clone();
        visit_mut::visit_stmt_mut(self, statement);
        if let Stmt::Expr(expression, Some(_)) = plain
            && matches!(expression, Expr::Assign(_) | Expr::Call(_) | Expr::MethodCall(_))
            && let Some(on) = self.switch(expression.span(), "statement deleted")
        {
            let now = statement.clone();
            *statement = parse_quote!(if !#on { #now });
        }
    }

    fn visit_expr_mut(&mut self, expression: &mut Expr) {
        let span = expression.span();
        let plain = expression.clone();
        match expression {
            Expr::Lit(_) => {}
            // The left side of an assignment must stay a place expression.
            Expr::Assign(assign) => return self.visit_expr_mut(&mut assign.right),
            Expr::Binary(binary) if is_assigning(&binary.op) => {
                let op_span = binary.op.span();
                self.visit_expr_mut(&mut binary.right);
                let changes = binary_changes(&plain);
                return self.offer(expression, op_span, changes);
            }
            // An operand that is borrowed mutably, dereferenced or indexed must stay a place expression.
            Expr::Reference(reference) if reference.mutability.is_some() => {
                return visit_mut::visit_expr_mut(self, &mut reference.expr);
            }
            Expr::Let(condition) => return self.visit_expr_mut(&mut condition.expr),
            _ => {}
        }
        visit_mut::visit_expr_mut(self, expression);
        match &plain {
            Expr::Binary(binary) if !holds_let(&plain) => {
                let changes = binary_changes(&plain);
                self.offer(expression, binary.op.span(), changes);
            }
            Expr::Unary(unary) if matches!(unary.op, UnOp::Neg(_) | UnOp::Not(_)) => {
                let inner = &unary.expr;
                let sign = if matches!(unary.op, UnOp::Neg(_)) { "-" } else { "!" };
                self.offer(expression, span, vec![(format!("{sign} deleted"), parse_quote!(#inner))]);
            }
            Expr::Lit(literal) => {
                let changes = literal_changes(&literal.lit);
                self.offer(expression, span, changes);
            }
            Expr::MethodCall(call) => {
                let changes = method_changes(call);
                self.offer(expression, call.method.span(), changes);
            }
            // A constant used by its name: the use is changed, because the value itself is needed when the crate is compiled.
            Expr::Path(path) if path.path.segments.last().is_some_and(|segment| is_constant(&segment.ident.to_string())) => {
                let change = format!("{} doubled", quiet(&plain));
                self.offer(expression, span, vec![(change, parse_quote!(crate::mutant_switch::Doubled::doubled(#plain)))]);
            }
            _ => {}
        }
    }
}

/// A name with a capital letter is a variant such as `None`, or a constant.
fn takes_all(pattern: &syn::Pat) -> bool {
    match pattern {
        syn::Pat::Wild(_) => true,
        syn::Pat::Ident(name) => name.ident.to_string().starts_with(|first: char| first.is_ascii_lowercase()),
        _ => false,
    }
}

/// `let` inside a condition binds names for the code after it, so it must stay in place.
fn holds_let(expression: &Expr) -> bool {
    match expression {
        Expr::Let(_) => true,
        Expr::Binary(binary) => holds_let(&binary.left) || holds_let(&binary.right),
        Expr::Paren(paren) => holds_let(&paren.expr),
        _ => false,
    }
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("test") || attribute.path().is_ident("cfg") && quiet(&attribute.meta).contains("test")
    })
}

/// More than one letter, no lower-case letter, and not a constant that is unchanged by doubling.
fn is_constant(name: &str) -> bool {
    !["INFINITY", "NEG_INFINITY", "NAN"].contains(&name)
        && name.len() > 1
        && name.chars().all(|letter| letter.is_ascii_uppercase() || letter.is_ascii_digit() || letter == '_')
}

fn is_assigning(op: &BinOp) -> bool {
    matches!(
        op,
        BinOp::AddAssign(_)
            | BinOp::SubAssign(_)
            | BinOp::MulAssign(_)
            | BinOp::DivAssign(_)
            | BinOp::BitOrAssign(_)
            | BinOp::BitAndAssign(_)
    )
}

fn binary_changes(plain: &Expr) -> Vec<(String, Expr)> {
    let Expr::Binary(binary) = plain else { return Vec::new() };
    let others: &[&str] = match binary.op {
        BinOp::Add(_) => &["-", "*"],
        BinOp::Sub(_) => &["+", "/"],
        BinOp::Mul(_) => &["+", "/"],
        BinOp::Div(_) => &["*", "+"],
        BinOp::Rem(_) => &["/", "+"],
        BinOp::And(_) => &["||"],
        BinOp::Or(_) => &["&&"],
        BinOp::BitAnd(_) => &["|"],
        BinOp::BitOr(_) => &["&"],
        BinOp::BitXor(_) => &["|"],
        BinOp::Shl(_) => &[">>"],
        BinOp::Shr(_) => &["<<"],
        BinOp::Eq(_) => &["!="],
        BinOp::Ne(_) => &["=="],
        BinOp::Lt(_) => &["<=", ">="],
        BinOp::Le(_) => &["<", ">"],
        BinOp::Gt(_) => &[">=", "<="],
        BinOp::Ge(_) => &[">", "<"],
        BinOp::AddAssign(_) => &["-="],
        BinOp::SubAssign(_) => &["+="],
        BinOp::MulAssign(_) => &["/="],
        BinOp::DivAssign(_) => &["*="],
        BinOp::BitOrAssign(_) => &["&="],
        BinOp::BitAndAssign(_) => &["|="],
        _ => &[],
    };
    let name = quiet(&binary.op);
    others
        .iter()
        .map(|other| {
            let mut changed = binary.clone();
            changed.op = syn::parse_str(other).expect("an operator");
            (format!("{name} to {other}"), Expr::Binary(changed))
        })
        .collect()
}

/// Twice the number, and 0; 0 becomes 1. Integers are increased and decreased by one.
fn literal_changes(literal: &Lit) -> Vec<(String, Expr)> {
    match literal {
        Lit::Float(float) => {
            let zero = float.base10_parse::<f64>().is_ok_and(|value| value == 0.0);
            if zero {
                vec![(format!("{float} to 1.0"), parse_quote!((#float + 1.0)))]
            } else {
                vec![
                    (format!("{float} doubled"), parse_quote!((#float * 2.0))),
                    (format!("{float} to 0.0"), parse_quote!((#float * 0.0))),
                ]
            }
        }
        Lit::Int(int) => {
            let up: Expr = parse_quote!((#int + 1));
            let mut changes = vec![(format!("{int} up"), up)];
            if int.base10_parse::<u64>().is_ok_and(|value| value > 0) {
                changes.push((format!("{int} down"), parse_quote!((#int - 1))));
            }
            changes
        }
        Lit::Bool(value) => {
            let other = !value.value;
            vec![(format!("{} to {other}", value.value), parse_quote!(#other))]
        }
        _ => Vec::new(),
    }
}

/// Methods that have an opposite, and calls that are omitted.
fn method_changes(call: &syn::ExprMethodCall) -> Vec<(String, Expr)> {
    const OPPOSITES: [(&str, &str); 8] = [
        ("min", "max"),
        ("next_up", "next_down"),
        ("round_up", "round_down"),
        ("floor", "ceil"),
        ("any", "all"),
        ("is_some", "is_none"),
        ("is_ok", "is_err"),
        ("take", "skip"),
    ];
    let name = call.method.to_string();
    let mut changes = Vec::new();
    for (one, other) in OPPOSITES {
        let opposite = if name == one {
            other
        } else if name == other {
            one
        } else {
            continue;
        };
        let mut changed = call.clone();
        changed.method = syn::Ident::new(opposite, call.method.span());
        changes.push((format!("{name} to {opposite}"), Expr::MethodCall(changed)));
    }
    if matches!(name.as_str(), "next_up" | "next_down" | "abs" | "sqrt" | "rev") {
        let receiver = &call.receiver;
        changes.push((format!("{name} deleted"), parse_quote!(#receiver)));
    }
    changes
}

/// Values that a function could return without doing its work.
fn results(output: &ReturnType) -> Vec<Expr> {
    let ReturnType::Type(_, kind) = output else { return vec![parse_quote!(())] };
    let Type::Path(path) = kind.as_ref() else { return Vec::new() };
    let Some(last) = path.path.segments.last() else { return Vec::new() };
    match last.ident.to_string().as_str() {
        "bool" => vec![parse_quote!(true), parse_quote!(false)],
        "f64" | "f32" => vec![parse_quote!(0.0), parse_quote!(1.0)],
        "usize" | "u64" | "u32" | "u16" | "u8" | "i64" | "i32" => vec![parse_quote!(0), parse_quote!(1)],
        "Option" => vec![parse_quote!(None)],
        "String" => vec![parse_quote!(String::new())],
        "Vec" => vec![parse_quote!(Vec::new())],
        "Result" if quiet(kind).starts_with("Result<()") => vec![parse_quote!(Ok(()))],
        _ => Vec::new(),
    }
}

/// Tokens as text, without spaces.
fn quiet(tokens: &impl ToTokens) -> String {
    tokens.to_token_stream().to_string().replace(' ', "")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::instrument;

    fn changes(text: &str) -> Vec<String> {
        let (_, mutants, _) = instrument(text, "a.rs", 0, &BTreeSet::new()).expect("sound text");
        mutants.into_iter().map(|mutant| mutant.change).collect()
    }

    #[test]
    fn each_change_has_a_switch_and_the_changed_branch_has_none() {
        let (text, mutants, after) =
            instrument("fn f(a: f64) -> f64 { (a + 2.0) * a }", "a.rs", 5, &BTreeSet::new()).expect("sound");
        assert_eq!(after, 5 + mutants.len());
        for mutant in &mutants {
            assert_eq!(text.matches(&format!("on({}usize)", mutant.number)).count(), 1, "{text}");
        }
        // The branch of `* to /` contains the sum unchanged.
        assert!(text.contains("(a + 2.0) / a"), "{text}");
        syn::parse_file(&text).expect("what is printed is read again");
    }

    #[test]
    fn a_mutant_that_is_left_out_keeps_the_numbers_of_the_others() {
        let text = "fn f(a: f64) -> bool { a < 1.0 }";
        let (_, all, after) = instrument(text, "a.rs", 0, &BTreeSet::new()).expect("sound");
        let (_, fewer, after_fewer) = instrument(text, "a.rs", 0, &BTreeSet::from([all[1].number])).expect("sound");
        assert_eq!((after, fewer.len()), (after_fewer, all.len() - 1));
        assert!(fewer.iter().all(|mutant| all.contains(mutant)));
    }

    #[test]
    fn tests_constants_patterns_and_macros_stay_as_they_are() {
        assert_eq!(changes("const A: f64 = 1.0 + 2.0;"), Vec::<String>::new());
        assert_eq!(changes("#[cfg(test)] mod tests { fn f() -> f64 { 1.0 + 2.0 } }"), Vec::<String>::new());
        assert_eq!(changes("const fn f(a: u8) -> u8 { a + 1 }"), Vec::<String>::new());
        let matched = changes("fn f(a: u8) -> S { match a { 1 => s(), _ => assert!(a < 2) } }");
        assert_eq!(matched, ["arm deleted"]);
    }

    #[test]
    fn a_body_that_is_a_value_already_is_not_changed_to_it() {
        assert_eq!(changes("fn f() -> u8 { 0 }"), ["0 up", "body to 1"]);
    }

    #[test]
    fn a_choice_may_be_an_operand() {
        let text = "fn f(a: f64, b: bool) -> S { s(if b { a } else { g } / a) }";
        assert_eq!(changes(text), ["/ to *", "/ to +"]);
    }

    #[test]
    fn a_condition_that_binds_a_name_keeps_its_place() {
        let text = "fn f(a: Option<f64>) -> S { if let Some(x) = a && x > g { s() } else { t() } }";
        assert_eq!(changes(text), ["> to >=", "> to <="]);
    }
}
